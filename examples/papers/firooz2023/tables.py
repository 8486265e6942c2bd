"""The printed convergence of Newton's method in firooz2023, Tables 4 to 8, and how ours is compared with it."""

from __future__ import annotations

from collections.abc import Mapping

import sources
from study import Claim, Line, Panel

COLUMNS = (20, 40, 60, 80, 100)


def printed(table: str, half: str = "analytical") -> dict[int, list[float]]:
    """Residual over the first one of iterations 1 to 6, by the elongation in percent."""
    found: dict[int, list[float]] = {column: [] for column in COLUMNS}
    for one in sources.printed("firooz2023", table):
        if one.line.startswith(half):
            found[int(one.line.split()[1])].append(one.y)
    return found


def told(values: list[float]) -> str:
    return ", ".join(f"{one:.3e}" for one in values)


def agree(ours: list[float], theirs: list[float]) -> bool:
    """Iterations 2 to 4 within 1 % or half of the last printed digit."""
    return len(ours) > 3 and all(
        abs(a - b) <= max(0.01 * b, 0.005 * 10.0 ** int(f"{b:.2e}".split("e")[1]))
        for a, b in zip(ours[1:4], theirs[1:4], strict=True)
    )


def column_row(
    table: str,
    column: int,
    ours: list[float],
    *,
    half: str = "analytical",
    what: str = "",
    correction: str = "",
    why: str = "",
    cheap: bool | None = None,
    other: list[float] | None = None,
) -> Claim:
    """A column of a table: iterations 2 to 4; `other` is what the independent program has of it."""
    theirs = printed(table, half)[column]
    holds = agree(ours, theirs)
    refuted = not holds and other is not None and agree(ours, other)
    return Claim(
        what or f"residuals of iterations 2, 3, 4 at {column} %",
        told(theirs[1:4]),
        told(ours[1:4]),
        holds,
        correction=correction,
        why="" if holds else why,
        refuted=refuted,
        source=f"the independent program has {told((other or [])[1:4])}" if refuted else "",
        cheap=column == 20 if cheap is None else cheap,
    )


def rounding_row(table: str, ours: list[float]) -> Claim:
    """Where the residual stops: after it every further iteration is rounding."""
    theirs = printed(table)[20][4:]
    return Claim(
        "residual where rounding stops Newton's method, at 20 %",
        told(theirs),
        f"{min(ours):.1e}",
        min(ours) < 1e-13,
        cheap=False,
    )


def panel(table: str, ours: Mapping[int, list[float]], title: str) -> Panel:
    lines = []
    for column, values in ours.items():
        lines.append(Line(f"{column} %", [float(k + 1) for k in range(len(values))], values))
    for column in ours:
        theirs = printed(table)[column]
        lines.append(Line(f"printed, {column} %", [float(k + 1) for k in range(len(theirs))], theirs, published=True))
    return Panel(title, "iteration", "residual / first residual", lines, log="y")
