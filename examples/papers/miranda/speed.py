"""What the square root costs: Table 2."""

from __future__ import annotations

from typing import Any

import numpy as np

from miranda.beams import CONTINUUM
from miranda.lattices import LATTICES, printed
from running import Run
from study import Claim, Found, Line, Number, Panel, Row

LAWS = {
    "s": "silling2000",
    "modified stretch": "miranda_modified_stretch",
    "modified stretch along the unit vector": "modified_stretch_along_bonds.piola",
}
WHY = {
    "modified stretch": "a bond takes a tenth of the paper's 50 ns here, so that its root and division weigh more",
    "modified stretch along the unit vector": "it keeps the root, and its energy, a cubic polynomial of the length, "
                                              "has no way along rows of a lattice as the other two have",
}
STEPS = 37_500
TURNS = 5
TAKEN = {"A": 600, "B": 75}
"""Steps of each turn, of which the time of all is worked out."""


def model(name: str) -> dict[str, Any]:
    """The scene's body at the spacing of a model."""
    one = next(lattice for lattice in LATTICES if lattice.name == name)
    return {"body.spacing": one.spacing, "horizon.radius": 2.0 * np.sqrt(3.0) * one.spacing}


def seconds(run: Run, name: str, law: str, turn: int) -> float:
    """On one thread, of a step of the motion."""

    def compute() -> float:
        step = 4e-4 * model(name)["body.spacing"] / 0.05
        result = run.scene("tension.toml", {
            **model(name), "material.potential": LAWS[law], "motion.end": TAKEN[name] * step, "motion.step": step,
        }).run(threads=1, progress=False)
        moved = next(phase for phase in result.summary["phases"] if phase["name"] == "move")
        return float(moved["wall_seconds"]) / int(result.summary["motion"]["steps_made"])

    took: float = run.once("seconds", compute, name, law, turn)
    return took


def pulled(run: Run) -> list[Row]:
    """Reactions and displacements of the two laws, at rest."""
    found = {}
    laws = list(LAWS.items())
    for name, law in laws if run.full else laws[:2]:
        result = run.solve("tension_at_rest.toml", {"material.potential": law})
        found[name] = float(result.reactions["right_x"][-1]), result.displacement
    force, u = found["s"]
    rows: list[Row] = []
    for name in list(found)[1:]:
        other, v = found[name]
        apart = max(abs(other / force - 1.0), float(np.abs(u - v).max() / np.abs(u).max()))
        rows.append(Claim(f"reactions and displacements, s and {name}", "less than 0.1 % apart",
                          f"{100 * apart:.3f} %", apart < 1e-3, cheap=name == "modified stretch"))
    return rows


def table02(run: Run) -> Found:
    """Times of all steps, worked out from some in turns; the least of the turns."""
    rows = pulled(run)
    notes = f"""Times are those of a run on one thread of this machine, of {STEPS} steps, worked out from
        {TAKEN['A']} (A) or {TAKEN['B']} (B) that the laws took in {TURNS} turns, the least of each; the machine was
        busy. Bonds of a lattice go row by row here, without lists of them. As eq. (5) stands, with the unit vector of
        the deformed bond, the modified stretch keeps the
        root. The paper's percentages are of the time with the modified stretch. Both models are pulled by 1 mm at
        one end; their material is that of Table 3 with K = {CONTINUUM / 1e9:.2f} GPa."""
    if not run.full:
        return Found(rows, [], notes)
    best: dict[tuple[str, str], float] = {}
    for name in TAKEN:
        for turn in range(TURNS):
            for law in LAWS:
                took = STEPS * seconds(run, name, law, turn)
                best[name, law] = min(took, best.get((name, law), np.inf))
    for name in TAKEN:
        times = {law: best[name, law] for law in LAWS}
        for law, line in (("s", "s"), ("modified stretch", "sbar")):
            took = printed("table02", f"seconds with {line} {name}")
            rows.append(Number(f"time with {law}, model {name}", times[law], unit="s",
                               why=f"the paper has {took:.0f} s by another program on another machine",
                               timed=True, cheap=False))
        for law in list(LAWS)[1:]:
            gain = 100.0 * (times["s"] / times[law] - 1.0)
            # Eq. (5) can be read in two ways; only one of them saves the root.
            theirs = printed("table02", f"percent {name}") if law == "modified stretch" else None
            rows.append(Number(f"time difference, model {name}, {law}", gain, theirs, 0.5, "%",
                               why=WHY[law], timed=True, cheap=False))
        gain = 100.0 * (times["s"] / times["modified stretch"] - 1.0)
        rows.append(Claim(f"the modified stretch saves time, model {name}", "more than 10 %", f"{gain:.0f} %",
                          gain > 10.0, timed=True, cheap=False))
    given = [printed("table02", f"seconds with {line} {name}") for name in "AB" for line in ("s", "sbar")]
    shares = [given[1] / given[0], given[3] / given[2]]
    lines = [Line("printed", [0.0, 1.0], shares, published=True)]
    for law in list(LAWS)[1:]:
        lines.append(Line(law, [0.0, 1.0], [best[name, law] / best[name, "s"] for name in TAKEN], style="o"))
    return Found(rows, [Panel("time over that with s", "model A, model B", "", lines, log="y")], notes, columns=1)
