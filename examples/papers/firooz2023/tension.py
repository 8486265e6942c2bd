"""Tables 4 to 8 of firooz2023: how the residual falls while a square and a cube are drawn to twice their length."""

from __future__ import annotations

import dataclasses
from typing import Any

from firooz2023.pointwise import Settings, extension
from firooz2023.tables import COLUMNS, column_row, panel, rounding_row
from running import Run
from study import Claim, Found, Row, figure

PAPER = "firooz2023"
CUBE = "../../firooz2023_table6/scene.toml"
# t rises by 0.18 and by 0.02 in turn: the columns are increments of 2 %, what is between them does not matter.
ENDS = "(t + 0.04*(1 - cos(10*pi*t)))*X"
SQUARE_RATIO = 2.8973e12 / 2.8266e6
CUBE_RATIO = 1.21e12 / 1.83e5
Columns = dict[int, list[float]]


def piola_columns(run: Run, scene: str, overrides: dict[str, Any], full: bool) -> Columns:
    """Residuals over the first one in the increments of 2 % that end at the columns; of the first column, if short."""
    given = {"steps.end": 1.0 if full else 0.2, "steps.increments": 10 if full else 2, **overrides}
    if scene == CUBE:
        given |= {"prescribe.0.u": [ENDS, 0, 0], "prescribe.1.u": [ENDS, 0, 0]}
    steps = run.solve(scene, given, may_fail=True).summary["steps"]
    found: Columns = {}
    for step in steps:
        column = round(100 * step["t"])
        if column in COLUMNS and abs(100 * step["t"] - column) < 1e-6:
            found[column] = [one / step["residual"][0] for one in step["residual"]]
    return found


def pointwise_columns(run: Run, settings: Settings, end: float) -> Columns:
    """The same by the independent program, with the increments that its settings have all the way."""
    found = run.once("pointwise", lambda: extension(settings, end)[0], repr(settings), end)
    return {round(100 * float(t)): values for t, values in found.items()}


def table(
    run: Run, name: str, ours: Columns, why: str, correction: str = "", half: str = "analytical",
    other: Columns | None = None,
) -> list[Row]:
    """A row per column; `other` are those of the independent program with the same settings."""
    rows: list[Row] = [
        column_row(
            name, column, ours.get(column, []), correction=correction, why=why, half=half,
            other=(other or {}).get(column),
        )
        for column in (COLUMNS if run.full else COLUMNS[:1])
    ]
    return rows


def halves(run: Run, table: str, name: str, settings: Settings) -> list[Row]:
    """Whether hyper-dual numbers and closed forms give the same residuals, by the independent program."""
    one = pointwise_columns(run, settings, 0.2).get(20, [])
    two = pointwise_columns(run, dataclasses.replace(settings, hyper_dual=True), 0.2).get(20, [])
    worst = max((abs(a / b - 1.0) for a, b in zip(one[:4], two[:4], strict=True)), default=1.0)
    return [
        Claim(
            f"{name}: hyper-dual numbers against closed forms, iterations 1 to 4 at 20 %",
            "the same digits",
            f"differ by at most {worst:.1e} of each",
            worst < 5e-3,
            cheap=False,
        ),
        rounding_row(table, one),
    ]


@figure(PAPER, "Table 5", "Newton's method for the square of bonds")
def table05(run: Run) -> Found:
    ours = piola_columns(run, "square.toml", {}, run.full)
    why = """the second residual is met within 0.2 %, the third is 0.4 to 1.9 % below the printed one, the fourth 1.6 %
        (40 %) to 9 % (100 %): no setting tried is nearer"""
    settings = Settings(2, 100, 3.0, inside=1, outside=2)
    other = pointwise_columns(run, settings, 1.0) if run.full else {}
    rows = table(run, "Table 5", ours, " ".join(why.split()), other=other)
    if run.full:
        rows += halves(run, "Table 5", "square of bonds", settings)
        worst = max(abs(a / b - 1.0) for a, b in zip(ours[20][1:4], other[20][1:4], strict=True))
        rows.append(
            Claim(
                "piola against the point-wise residual with its own tangent, at 20 %",
                "one residual, (17)",
                f"differ by at most {worst:.1e}",
                worst < 1e-4,
                cheap=False,
            )
        )
    notes = """The paper states no clamps, no increments and no start. Clamps here: the first layer of points and two
        outside, both moved by t X; increments of 2 % from the last equilibrium. Tried at 20 % (printed 6.19e-2,
        5.20e-4, 4.28e-8): two layers inside and one outside 6.155e-2, 5.025e-4, 3.904e-8; three inside
        6.119e-2, 4.860e-4, 3.572e-8; one and one 6.267e-2, 5.299e-4, 4.332e-8; ends that move as rigid bodies
        5.891e-2, 4.348e-4, 2.837e-8; weights by each point's own number of neighbours 6.135e-2, 5.125e-4,
        4.201e-8; neighbours by the rounded distance of rounded coordinates, made in six ways, which lose 32 to
        84 % of the bonds of three spacings, 6.40e-2 to 6.68e-2. None is nearer than the recipe of Table 6,
        which is met."""
    return Found(rows, [panel("Table 5", ours, "C2 = 0")], notes)


@figure(PAPER, "Table 6", "Newton's method for the cube of bonds")
def table06(run: Run) -> Found:
    ours = piola_columns(run, CUBE, {}, run.full)
    correction = "a horizon of 2 spacings where 3 are printed"
    rows = table(run, "Table 6", ours, "", correction)
    if run.full:
        rows += halves(run, "Table 6", "cube of bonds", Settings(3, 20, 2.0))
    notes = """Clamps: the first layer of points and one outside the cube, both moved by t X. With each point's own
        number of neighbours in V^i (3.878e-2, 7.306e-5, 3.634e-10 at 20 %) the table is missed by 3 to 5 %, so
        that V^i is the same for all points. With the horizon of 3 spacings as printed, 3.684e-2, 5.360e-5 and
        1.288e-10 where 3.99e-2, 7.66e-5 and 3.79e-10 are printed."""
    return Found(rows, [panel("Table 6", ours, "C2 = C3 = 0, horizon of 2 spacings")], notes)


@figure(PAPER, "Table 4", "Newton's method for the nearly incompressible square")
def table04(run: Run) -> Found:
    end = 1.0 if run.full else 0.2
    overrides: dict[str, Any] = {
        "steps.end": end,
        "steps.increments": round(50 * end),
        "prescribe.0.u": ["t*X", 0],
        "prescribe.1.u": ["t*X", 0],
    }
    ours = piola_columns(run, "square.toml", {**overrides, "material.parameters.C2": SQUARE_RATIO}, run.full)
    settings = Settings(2, 100, 3.0, inside=1, outside=2, c2=SQUARE_RATIO)
    rows = table(run, "Table 4", ours, AS_PRINTED, other=pointwise_columns(run, settings, end))
    panels = [panel("Table 4", ours, "C2/C1 as printed")]
    if run.full:
        fitted = {**overrides, "material.parameters.C2": FITTED * SQUARE_RATIO}
        less = piola_columns(run, "square.toml", fitted, run.full)
        panels.append(panel("Table 4", less, f"C2 times {FITTED}"))
    notes = """Clamps and increments as in Table 5, C2/C1 = 1.025e6. Tried at 20 % (printed 3.53e-2, 1.31e-3,
        2.30e-6), C2 times 0.1: 3.561e-2, 3.679e-3, 2.341e-5;
        0.05: 3.444e-2, 1.441e-3, 2.882e-6; 0.046: 3.457e-2, 1.275e-3, 2.149e-6; 0.025: 3.731e-2, 5.25e-4,
        1.69e-7; 0.1 with a horizon of two spacings: 3.373e-2, 1.980e-3, 1.289e-5. So a C2 of 0.0468 times the
        printed one gives the third and the fourth residual at 20 %, and misses the second by 2 %; from 40 % on the
        printed ones fall more slowly than with it: the third are 3 to 6 times ours, the fourth 11 to 2800 times. With
        the literal C2, by the independent program with the paper's point-wise residual and its own unsymmetric
        tangent, full steps: with one V^ij for all points the same as piola to seven digits at 20, 40 and 60 %,
        for then that residual is the gradient of one energy; at 76 % the first triangles at the corners are turned inside
        out, and the two programs go on to different equilibria. V^ij as powers of V^i 5.014e-2, 1.505e-2, 1.956e-4; by
        each point's own count of pairs 8.213e-2, 3.866e-2, 1.848e-3, with its part of VH squared 5.871e-2,
        1.769e-2, 4.073e-4; with pairs that need not be neighbours of each other, or must be nearer than the
        horizon, or clamps of one layer outside, Newton's method with full steps of 2 % does not reach 20 %."""
    return Found(rows, list(panels), notes)


FITTED = 0.0468
AS_PRINTED = "from 76 % on triangles at the corners are turned inside out, and the programs find different equilibria"


@figure(PAPER, "Table 7", "Newton's method for the cube with areas")
def table07(run: Run) -> Found:
    fitted = 4210.0
    ours = piola_columns(run, CUBE, {"material.parameters.C2": fitted}, run.full)
    why = "a C2 fitted to one number does not meet this column"
    rows = table(run, "Table 7", ours, why, "C2/C1 = 4210 (fitted: the paper prints none) and a horizon of 2 spacings")
    if run.full:
        both = halves(run, "Table 7", "cube with areas", Settings(3, 20, 2.0, c2=fitted))
        other = column_row(
            "Table 7",
            20,
            ours[20],
            half="hyper-dual",
            cheap=False,
            what="at 20 %, the half of hyper-dual numbers",
            why="the halves differ in print, 3.60e-2 and 3.65e-2: the printed halves are of different runs",
        )
        other.refuted = isinstance(both[0], Claim) and both[0].holds
        other.source = "another program, by hyper-dual numbers and in closed form alike (next row)"
        rows += [other, *both]
    notes = """The paper prints no C2 of this cube. With the recipe of Table 6 and one V^ij for all points a single
        number, C2/C1 = 4210 (C2 delta^4/C1 = 0.42), fitted to the fourth residual at 100 %, gives all fifteen
        residuals of the half of closed forms within 1 %. With 6.61e6, as footnote 3 has it, they are 3.522e-2,
        1.965e-4 and 1.171e-8 at 20 %: it means C3. The half of hyper-dual numbers has other ones at 20 %
        alone. Tried besides at 20 % (printed 3.65e-2, 1.22e-4, 2.58e-9): C2/C1 from 1e2 to 1e6; weights
        `truncated` (at 4500: 3.628e-2, 1.202e-4, 2.466e-9); and by the independent program with the point-wise
        residual at C2/C1 = 6.6e6: V^ij by each point's own count of pairs 4.292e-2, 2.867e-4, 2.30e-8, with its
        part of VH squared 3.425e-2, 1.856e-4, 1.05e-8, or once 3.755e-2, 2.222e-4, 1.48e-8; and for pairs that
        need not be neighbours of each other 3.946e-2, 1.299e-4, 3.53e-9 (own), 3.325e-2, 7.43e-5, 1.09e-9 (part
        squared), 3.555e-2, 9.52e-5, 1.93e-9 (once), 3.315e-2, 7.34e-5, 1.05e-9 (one V^ij)."""
    return Found(rows, [panel("Table 7", ours, "C2/C1 = 4210, horizon of 2 spacings")], notes)


@figure(PAPER, "Table 8", "Newton's method for the cube with volumes")
def table08(run: Run) -> Found:
    factor = 1.28
    ours = piola_columns(run, CUBE, {"material.parameters.C3": factor * CUBE_RATIO}, run.full)
    correction = "C3 larger by 28 % (fitted), a horizon of 2 spacings where 3 are printed, C3 for the C2 of footnote 3"
    why = "the second residual is 1.1 % below the printed one, the others are met"
    rows = table(run, "Table 8", ours, why, correction)
    if run.full:
        rows += halves(run, "Table 8", "cube with volumes", Settings(3, 20, 2.0, c3=CUBE_RATIO))
    notes = """With the recipe of Table 6. The printed C3 misses every column (3.401e-2, 9.619e-5, 1.330e-9 at 20 %,
        1.735e-2, 1.276e-5, 1.250e-11 at 100 %), and no reason was found for one that is 28 % larger. Tried at 20 %
        (printed 3.37e-2, 1.04e-4, 1.60e-9): C3 from half to three
        times the printed one with weights `uniform` (at 1.25: 3.338e-2, 1.028e-4, 1.563e-9; at 1.28 all columns
        are met but the second residual at 20 %, 1.1 % low) and `truncated` (3.309e-2, 9.625e-5, 1.319e-9); and
        by the independent program with the point-wise residual and its own unsymmetric tangent: V^ijk by each
        point's own count of triplets 3.966e-2, 1.444e-4, 2.72e-9, with its part of VH once 3.652e-2, 1.205e-4,
        2.10e-9, twice 3.413e-2, 9.73e-5, 1.36e-9, three times 3.272e-2, 8.03e-5, 9.1e-10; VH/N3 without the
        powers of VH 3.35e-1, 1.10e-1, 3.6e-2; powers of the cell's volume 3.918e-2, 7.48e-5, 4.0e-10;
        neighbours of each other that must be nearer than the horizon 3.495e-2, 1.126e-4, 1.97e-9 (one V^ijk),
        3.346e-2, 8.94e-5, 1.20e-9 (cubed), 4.04e-2, 1.73e-4, 4.65e-9 (own); triplets with two of three
        distances within the horizon 3.128e-2, 6.74e-5, 5.7e-10; and all triplets, part cubed, 2.219e-2,
        2.52e-5, 6.1e-11. With one V^ijk for all points and mutual neighbours the point-wise residual is the
        gradient of one energy, and the two programs agree."""
    return Found(rows, [panel("Table 8", ours, "C3/C1 = 8.46e6, horizon of 2 spacings")], notes)
