"""What is read off plates that break."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import piola
from study import Map

Values = NDArray[np.float64]

# Of the crack is what has lost so much of its family; a point beside a crack through all bonds has 0.4 and more.
DAMAGED = 0.35

LAW = "st_venant_kirchhoff_brittle"  # of the library


def gradients(bulk: float, shear: float, gc: float, kernel: str, **settings: Any) -> dict[str, Any]:
    """Saint Venant and Kirchhoff's law with bonds that break, with settings of [correspondence]."""
    return {
        "material.potential": LAW,
        "material.parameters": {"K": bulk, "G": shear, "Gc": gc},
        "correspondence.influence": kernel,
        **{f"correspondence.{key}": value for key, value in settings.items()},
    }


@dataclass
class Plate:
    """A plate with a crack along X in the middle of its height, after a run."""

    result: piola.Result
    spacing: float
    length: float
    height: float

    @property
    def ended(self) -> str:
        """How the run ended, with its time in us."""
        summary = self.result.summary
        return f"{summary['exit_reason']} at {1e6 * summary['motion']['t']:.1f} us"

    @property
    def completed(self) -> bool:
        return bool(self.result.summary["exit_reason"] == "completed")

    @property
    def points(self) -> int:
        """How many points the plate has."""
        return int(self.result.summary["points"])

    def passed(self, x: float) -> float:
        """When the tip came beyond a place, in s; nan if never."""
        table = self.result.table("fracture")
        beyond = np.flatnonzero(table["tip_tip"] > x)
        return float(table["t"][beyond[0]]) if len(beyond) else float("nan")

    @property
    def first(self) -> float:
        """When the first bond broke, in s."""
        table = self.result.table("fracture")
        return float(table["t"][np.flatnonzero(table["new_bonds"] > 0)[0]])

    @property
    def broken(self) -> int:
        """How many bonds broke, without those that the crack had cut from the start."""
        bonds = self.result.table("fracture")["broken_bonds"]
        return int(bonds[-1] - bonds[0])

    @property
    def tip(self) -> float:
        """The farthest that the crack came, in m."""
        return float(np.nanmax(self.result.table("fracture")["tip_tip"]))

    @property
    def through(self) -> bool:
        """Whether the crack came to the last two columns of points."""
        return self.tip > self.length - 2.0 * self.spacing

    @property
    def speed(self) -> float:
        """Mean of the tip from a tenth to nine tenths of its way, in m/s."""
        table = self.result.table("fracture")
        way = (table["tip_tip"] - 0.5 * self.length) / (0.5 * self.length)
        part = (way > 0.1) & (way < 0.9)
        return float(np.polyfit(table["t"][part], table["tip_tip"][part], 1)[0])

    def straight(self) -> float:
        """The share of damaged points in front of the first crack that lie within two rows of its plane."""
        last = self.result.frames[-1]
        free = (last.positions[:, 1] > 2 * self.spacing) & (last.positions[:, 1] < self.height - 2 * self.spacing)
        found = free & (last["damage"] > DAMAGED) & (last.positions[:, 0] > 0.5 * self.length)
        near = np.abs(last.positions[:, 1] - 0.5 * self.height) < 2.0 * self.spacing
        return float((found & near).sum() / max(1, found.sum()))

    def torn(self) -> tuple[int, float]:
        """How many points have lost seven tenths of their family, and how far at most from an edge, in spacings."""
        last = self.result.frames[-1]
        places = last.positions[last["damage"] > 0.7, 0]
        far = np.minimum(places, self.length - places) / self.spacing
        return len(places), float(far.max()) if len(places) else 0.0

    def spread(self) -> float:
        """The share of all points that are damaged."""
        return float((self.result.frames[-1]["damage"] > DAMAGED).mean())

    def runs_straight(self) -> bool:
        """Whether one straight crack went through the plate: nine tenths of the damage in its plane."""
        return self.completed and self.through and self.straight() > 0.9

    def columns(self) -> Values:
        """Damage by columns and rows, the larger of the two layers in the middle."""
        last = self.result.frames[-1]
        places = np.floor(last.positions / self.spacing + 1e-6).astype(int)
        damage = np.zeros(tuple(places.max(axis=0) + 1))
        damage[tuple(places.T)] = last["damage"]
        n = damage.shape[2]
        layers: Values = damage[:, :, n // 2 - 1 : n // 2 + 1].max(axis=2)
        return layers

    def fork(self) -> float:
        """Where the crack has two arms or more over three columns, two horizons in front of its start; nan if nowhere.

        Arms of a column are groups of damaged points with more than one intact point between them.
        """
        arms = [groups(column > DAMAGED) for column in self.columns()]
        first = round((0.5 * self.length + 2 * 3.015 * self.spacing) / self.spacing)
        for k in range(first, len(arms) - 2):
            if min(arms[k : k + 3]) >= 2:
                return (k + 0.5) * self.spacing
        return float("nan")

    def map(self, title: str) -> Map:
        """Damage of the layers in the middle, as the figure shows it."""
        return Map(title, self.columns().T.tolist(), "damage", (0.0, 1.0), "turbo")


def groups(damaged: NDArray[np.bool_]) -> int:
    """How many groups there are, with gaps of at most one intact point inside a group."""
    places = np.flatnonzero(damaged)
    return int(len(places) > 0) + int((np.diff(places) > 2).sum())
