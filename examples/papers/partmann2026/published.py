"""Numbers that the paper prints."""

from __future__ import annotations

from sources import printed
from study import Line, Number

PAPER = "partmann2026"
ANOTHER = "another program"


def line(figure: str, name: str) -> Line:
    """What is printed of a line, to be drawn."""
    rows = [one for one in printed(PAPER, figure) if one.line == name]
    return Line(
        f"{name} (paper)", [one.x for one in rows], [one.y for one in rows],
        published=True, reading=max(one.reading for one in rows),
    )


def number(
    figure: str, name: str, x: float, what: str, ours: float, cheap: bool = True, correction: str = "",
    independent: float | None = None, why: str = "",
) -> Number:
    """A row that is compared with what is printed, in per cent."""
    found = next(one for one in printed(PAPER, figure) if one.line == name and one.x == x)
    source = "" if independent is None else ANOTHER
    return Number(
        what, ours, found.y, found.reading, "%", independent=independent, source=source,
        correction=correction, why=why, cheap=cheap,
    )
