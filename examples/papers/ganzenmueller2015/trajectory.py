"""The patch in motion: what is kept of a run, and its contractions."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import piola

from ganzenmueller2015.families import Array, Families
from running import Run

# Elastic constants of E = 1 Pa and nu = 0.3 in plane strain, kg/m^3, and 444 points in a square of 1 m.
LAMBDA, MU, DENSITY = 0.3 / 0.52, 0.5 / 1.3, 1.0
STEP = 0.15 / np.sqrt(444.0) / np.sqrt((LAMBDA + 2.0 * MU) / DENSITY)
# Contractions of which there are pictures.
SHOWN = (1, 3, 10)


@dataclass
class Trajectory:
    """A patch at every fourth step."""

    t: Array
    """Time, s."""
    moment: Array
    """Second moment of area about the mean point, m^4."""
    disorder: Array
    """`Families.disorder`."""
    incoherent: Array
    """`Families.incoherent` over the energy that is stored at the start."""
    kinetic: Array
    """Kinetic energy over it."""
    drift: float
    """Largest change of kinetic and stored energy, over the energy at the start."""
    momentum: float
    """Largest momentum over mass times the largest root mean square velocity."""
    turning: float
    """Largest angular momentum, over that of mass, half a metre and this velocity."""
    x: dict[int, Array]
    """Positions at the ends of some contractions, m."""

    def contractions(self) -> list[int]:
        """Where the second moment has its minima."""
        return minima(self.moment)

    def period(self) -> float:
        """Mean time from one contraction to the next, s."""
        return float(np.diff(self.t[self.contractions()]).mean())

    def over_contractions(self, values: Array, count: int) -> list[float]:
        """Means over the first so many contractions, each up to its minimum."""
        ends = [0, *self.contractions()]
        return [float(values[a:b].mean()) for a, b in pairwise(ends[: count + 1])]


def minima(values: Any) -> list[int]:
    """Where values have a local minimum."""
    return [k for k in range(1, len(values) - 1) if values[k] < values[k - 1] and values[k] <= values[k + 1]]


def follow(run: Run, scene: str, over: dict[str, Any], families: Families, X: Array) -> Trajectory:
    """Runs a scene of a patch and measures every frame; the frames themselves are not kept."""

    def compute() -> Any:
        with tempfile.TemporaryDirectory() as folder:
            return measured(run.scene(scene, over).run(Path(folder) / "out", progress=False), families, X)

    found = run.once("trajectory", compute, run.path(scene).read_text(), sorted(over.items()))
    arrays: dict[str, Any] = {
        name: np.array(found[name]) for name in ("t", "moment", "disorder", "incoherent", "kinetic")
    }
    single: dict[str, Any] = {name: found[name] for name in ("drift", "momentum", "turning")}
    return Trajectory(**arrays, **single, x={int(k): np.array(x) for k, x in found["x"].items()})


def measured(result: piola.Result, f: Families, X: Array) -> dict[str, Any]:
    """As plain numbers."""
    frames = result.frames
    table = result.table("motion")
    moment, disorder, incoherent, kinetic = [], [], [], []
    for frame in frames:
        x = X + frame["displacement"][:, :2]
        centre = (f.V[:, None] * x).sum(0) / f.V.sum()
        moment.append(float((f.V * ((x - centre) ** 2).sum(1)).sum()))
        disorder.append(f.disorder(x))
        v = frame["velocity"][:, :2]
        incoherent.append(f.incoherent(v, DENSITY) / table["stored"][0])
        kinetic.append(float(DENSITY / 2.0 * (f.V * (v**2).sum(1)).sum() / table["stored"][0]))
    t = np.array([frame.t for frame in frames])
    ends = minima(moment)
    shown = {k: ends[k - 1] for k in SHOWN if k <= len(ends)}
    # With the velocities half a step before and behind: those of leap-frog are half a step early.
    energy = table["kinetic_leapfrog"] + table["stored"]
    mass = DENSITY * f.V.sum()
    swiftest = np.sqrt(2.0 * table["kinetic"].max() / mass)
    momentum = max(np.abs(table[f"momentum_{axis}"]).max() for axis in "xy")
    return {
        "t": t.tolist(),
        "moment": moment,
        "disorder": disorder,
        "incoherent": incoherent,
        "kinetic": kinetic,
        "drift": float(np.abs(energy / energy[0] - 1.0).max()),
        "momentum": float(momentum / (mass * swiftest)),
        "turning": float(np.abs(table["angular_momentum_z"]).max() / (mass * 0.5 * swiftest)),
        "x": {str(k): (X + frames[at]["displacement"][:, :2]).tolist() for k, at in shown.items()},
    }
