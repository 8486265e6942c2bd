"""Numbers that the paper prints."""

from __future__ import annotations

import csv
from pathlib import Path

from study import Line, Number

PAPER = "partmann2026"
ANOTHER = "another program"


def read(figure: str) -> list[dict[str, str]]:
    """The rows of a figure in published.csv."""
    path = Path(__file__).with_name("published.csv")
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if row["figure"] == figure]


def line(figure: str, name: str) -> Line:
    """What is printed of a line, to be drawn."""
    rows = [row for row in read(figure) if row["line"] == name]
    return Line(
        f"{name} (paper)", [float(row["x"]) for row in rows], [float(row["y"]) for row in rows],
        published=True, reading=max(float(row["reading"]) for row in rows),
    )


def number(
    figure: str, name: str, x: float, what: str, ours: float, cheap: bool = True, correction: str = "",
    independent: float | None = None, why: str = "",
) -> Number:
    """A row that is compared with what is printed, in per cent."""
    found = next(row for row in read(figure) if row["line"] == name and float(row["x"]) == x)
    source = "" if independent is None else ANOTHER
    return Number(
        what, ours, float(found["y"]), float(found["reading"]), "%", independent=independent, source=source,
        correction=correction, why=why, cheap=cheap,
    )
