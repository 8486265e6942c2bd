"""Clouds, their families, and what is left of a displacement beside its gradient."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from sources import printed

PAPER = "ganzenmueller2015"

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


def published(figure: str) -> list[float]:
    """The numbers that the paper prints for a figure, in the order of `published.csv`."""
    return [one.y for one in printed(PAPER, figure)]


def cloud() -> tuple[Array, Array]:
    """Positions in m and areas in m^2 of the patch of the independent program, `cloud.csv`."""
    with Path(__file__).with_name("cloud.csv").open(encoding="utf-8") as file:
        rows = [[float(row[name]) for name in ("x", "y", "volume")] for row in csv.DictReader(file)]
    table = np.array(rows)
    return table[:, :2], table[:, 2]


@dataclass
class Families:
    """Ordered pairs: point `i` has `j` in its family, at `X` (m) from it, with the weight `w`.

    Pairs of a radius of each point's own need not have their reverse among them.
    """

    n: int
    i: Whole
    j: Whole
    X: Array
    w: Array
    V: Array
    """Volumes of points, m^d."""

    def gather(self, values: Array) -> Array:
        """Sums what pairs have over the family of every point."""
        flat = values.reshape(len(self.i), -1)
        summed = np.stack([np.bincount(self.i, one, self.n) for one in flat.T], axis=-1).astype(float)
        found: Array = summed.reshape(self.n, *values.shape[1:])
        return found

    def difference(self, values: Array) -> Array:
        """What the neighbour has less what the point has."""
        change: Array = values[self.j] - values[self.i]
        return change

    @cached_property
    def slopes(self) -> list[scipy.sparse.csr_matrix]:
        """For each axis the matrix that makes of values at points their slopes (eq. 31)."""
        g = np.einsum("nab,nb->na", np.linalg.inv(self.shape())[self.i], self.X) * (self.w * self.V[self.j])[:, None]
        ends = (np.concatenate([self.i, self.i]), np.concatenate([self.j, self.i]))
        shape = (self.n, self.n)
        return [scipy.sparse.csr_matrix((np.concatenate([one, -one]), ends), shape) for one in g.T]

    def tensor(self, a: Array, b: Array) -> Array:
        """Sum of w V_j a b over every family, a and b vectors of pairs."""
        return self.gather((self.w * self.V[self.j])[:, None, None] * a[:, :, None] * b[:, None, :])

    def shape(self) -> Array:
        """The shape tensors K (eq. 30)."""
        return self.tensor(self.X, self.X)

    def gradient(self, values: Array) -> Array:
        """Of a vector per point: the deformation gradient of positions (eq. 31)."""
        found: Array = np.stack([slope @ values for slope in self.slopes], axis=-1)
        return found

    def nonaffine(self, values: Array) -> Array:
        """Of every pair what its difference has beside the gradient at its first point."""
        affine = np.einsum("nab,nb->na", self.gradient(values)[self.i], self.X)
        left: Array = self.difference(values) - affine
        return left

    def disorder(self, x: Array) -> float:
        """Nonaffine part of pairs over their lengths at rest: root mean squares, weighted by volumes."""
        weight = self.V[self.i] * self.V[self.j]
        left, rest = (self.nonaffine(x) ** 2).sum(1), (self.X**2).sum(1)
        return float(np.sqrt((weight * left).sum() / (weight * rest).sum()))

    def incoherent(self, v: Array, density: float) -> float:
        """Kinetic energy in J of the nonaffine part of velocities."""
        weight = self.V[self.i] * self.V[self.j]
        family = self.gather(self.V[self.j])
        left = (weight * (self.nonaffine(v) ** 2).sum(1)).sum()
        return float(density / 2.0 * left / (2.0 * family.mean()))


def families(X: Array, V: Array, radius: float | Array) -> Families:
    """All within `radius`, one for all points or each its own, with the unit weight of the paper."""
    n = len(X)
    offset = X[None, :, :] - X[:, None, :]
    length = np.sqrt((offset**2).sum(2))
    radii = np.broadcast_to(np.asarray(radius, dtype=float), n)
    i, j = np.nonzero((length <= radii[:, None]) & ~np.eye(n, dtype=bool))
    return Families(n, i, j, offset[i, j], np.ones(len(i)), V)


def own_radii(X: Array, neighbours: int) -> Array:
    """The distance to the last of so many neighbours, a hair longer."""
    length = np.sqrt(((X[None, :, :] - X[:, None, :]) ** 2).sum(2))
    found: Array = np.sort(length, axis=1)[:, neighbours] * (1.0 + 1e-12)
    return found
