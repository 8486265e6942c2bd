"""The beam in motion: settings that the paper's text leaves open, and what is measured of a run."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import piola

from ganzenmueller2015.families import Array
from running import Run

SPEED = 40.0
"""In m/s; waves have 7060 m/s."""
STRETCH = 57.6923076923077 + 2.0 * 38.4615384615385
"""lambda + 2 mu in GPa; lambda is the first."""
UNSTABLE = {"nodal": {}, "stabilised": {"correspondence.discretisation": "stabilised"}}

PUSHED = "beam_pushed.toml"
CORNERS = {
    "sets.left": "X < 0.2e-3 and Y < 0.2e-3",
    "sets.right": "X > 7.8e-3 and Y < 0.2e-3",
    "sets.middle": "abs(X - 4e-3) < 0.2e-3 and Y > 0.8e-3",
}
SUPPORTS: dict[str, tuple[str, dict[str, Any]]] = {
    "left end held, right end lifted": ("beam.toml", {}),
    "left end held, right end lifted straight up": ("beam.toml", {"prescribe.1.u": [0, "40*t"]}),
    "ends on rollers, middle pushed": (PUSHED, {}),
    "lower corners on rollers, middle pushed from above": (PUSHED, CORNERS),
    "ends held, middle pushed": (PUSHED, {"prescribe.0.u": [0, 0], "prescribe.1.u": [0, 0]}),
}


@dataclass
class Bent:
    """A beam at every 0.2 mm, as far as it came."""

    way: Array
    """Boundary displacement, m."""
    pairing: Array
    """How much neighbours along the beam alternate between near and far, over the spacing: root mean square."""
    x: list[Array]
    """Positions, m."""
    stress: list[Array]
    """S_xx in GPa."""
    ended: str
    """`completed`, or how the run ended."""
    steps: int


def measured(result: piola.Result, spacing: float) -> dict[str, Any]:
    """As plain numbers, of every frame."""
    columns, rows = round(8e-3 / spacing), round(1e-3 / spacing)
    way, pairing, xs, stress = [], [], [], []
    for frame in result.frames:
        x = (frame.positions + frame["displacement"])[:, :2]
        grid = x.reshape(columns, rows, 2)
        apart = np.sqrt((np.diff(grid, axis=0) ** 2).sum(2))
        pairing.append(float(np.sqrt((np.diff(apart, axis=0)[1:-1] ** 2).mean()) / spacing))
        E = frame["strain"].reshape(-1, 3, 3)
        lame = STRETCH - 2.0 * 38.4615384615385
        stress.append((STRETCH * E[:, 0, 0] + lame * E[:, 1, 1]).tolist())
        way.append(SPEED * frame.t)
        xs.append(x.tolist())
    return {
        "way": way,
        "pairing": pairing,
        "x": xs,
        "stress": stress,
        "ended": result.summary["exit_reason"],
        "steps": result.summary["motion"]["steps_made"],
    }


def bend(run: Run, scene: str, over: dict[str, Any], spacing: float = 0.1e-3) -> Bent:
    """Runs the beam; a run that ends early is a result, too."""

    def compute() -> Any:
        made = run.scene(scene, {**over, "body.spacing": spacing})
        with tempfile.TemporaryDirectory() as folder:
            try:
                result = made.run(Path(folder) / "out", progress=False)
            except piola.Error as error:
                if getattr(error, "result", None) is None:
                    raise
                result = error.result
            return measured(result, spacing)

    found = run.once("bend", compute, run.path(scene).read_text(), sorted(over.items(), key=str), spacing)
    return Bent(
        way=np.array(found["way"]),
        pairing=np.array(found["pairing"]),
        x=[np.array(one) for one in found["x"]],
        stress=[np.array(one) for one in found["stress"]],
        ended=found["ended"],
        steps=found["steps"],
    )
