"""The point-wise residual of firooz2023, (17)-(20) and (34)-(39), with its own tangent: independent of piola.

A box is drawn along x, symmetrically about its middle. Only the points of one quadrant (octant) are kept, and the
others are their mirror images, which changes nothing but the size of the equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from math import pi
from typing import Any

import numpy as np
from firooz2023 import hyper_dual
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# The columns of [e_i]x: cross(a)[i, j] b[j] = (a x b)[i].
LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    LEVI_CIVITA[_i, _j, _k], LEVI_CIVITA[_j, _i, _k] = 1.0, -1.0


@dataclass(frozen=True)
class Settings:
    """What the paper prints, and what it leaves open. Lengths are parts of the box's edge, which is 1."""

    dimension: int
    cells: int
    """Spacings along an edge."""
    horizon: float
    """In spacings."""
    c1: float = 1.0
    c2: float = 0.0
    c3: float = 0.0
    n: float = 1.0
    inside: int = 1
    """Layers of the box that each clamp holds."""
    outside: int = 1
    """Layers beyond the box that each clamp adds."""
    mutual: bool = True
    """Whether neighbours must be neighbours of each other, too."""
    weights: str = "uniform"
    """`uniform`: VH^k/N_k of a bulk point; `own`: each point's own number of neighbours, pairs, triplets with the
    whole VH; `truncated`: with its part of VH, too; `product`: powers of VH/N_1; `cells`: powers of the cell."""
    rigid: bool = False
    """Whether each clamp moves as a rigid body (else by t X)."""
    increment: float = 0.02
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """On the three kinds."""
    hyper_dual: bool = False
    """Whether derivatives of the energies are taken by hyper-dual numbers."""
    halved: bool = False
    """Whether points on the surface have the part of a cell that lies in the body (else all have the same)."""
    rounding: str = ""
    """Empty where whole numbers decide who is a neighbour; else how coordinates are made that are then rounded."""


def cross(a: Array) -> Array:
    """The matrix of a x."""
    return np.asarray(np.einsum("jki,...j->...ik", LEVI_CIVITA, a))


def strain_law(ratio: Array, n: float) -> tuple[Array, Array]:
    """Of S^2/2 with Seth's and Hill's strain: its first and second derivative by the ratio."""
    strain = (ratio**n - 1.0) / n if n else np.log(ratio)
    slope = ratio ** (n - 1.0)
    return strain * slope, slope**2 + strain * (n - 1.0) * ratio ** (n - 2.0)


def radial(a: Array, size: Any, n: float) -> tuple[Array, Array]:
    """Gradient and Hessian by the vector a of size S(|a|/size)^2/2."""
    now = np.linalg.norm(a, axis=-1)
    first, second = strain_law(now / size, n)
    e = a / now[..., None]
    ee = e[..., :, None] * e[..., None, :]
    M = (second / size)[..., None, None] * ee + (first / now)[..., None, None] * (np.eye(3) - ee)
    return first[..., None] * e, M


class Body:
    """Points, neighbours and weights of one quadrant or octant."""

    def __init__(self, s: Settings) -> None:
        self.s, d = s, s.dimension
        assert s.cells % 2 == 0
        half = s.cells // 2
        self.h = 1.0 / s.cells
        self.extent = np.array([half + s.outside] + [half] * (d - 1))
        low = -self.extent if s.rounding else 0 * self.extent
        self.place: Indices = np.array(
            list(product(*(range(a, e + 1) for a, e in zip(low, self.extent, strict=True)))), dtype=np.int64
        )
        stride = np.array([int(np.prod((self.extent - low)[k + 1 :] + 1)) for k in range(d)])
        self.X: Array = np.asarray(self.place * self.h, dtype=np.float64)
        self.radial, self.scalar = (hyper_dual.radial, hyper_dual.scalar) if s.hyper_dual else (radial, strain_law)
        reach = int(s.horizon)
        around = (o for o in product(range(-reach, reach + 1), repeat=d) if any(o))
        # Squares of whole numbers: no rounding decides who is a neighbour.
        self.offsets: Indices = np.array([o for o in around if sum(c * c for c in o) <= s.horizon**2], dtype=np.int64)
        self.offsets3: Array = np.zeros((len(self.offsets), 3))
        self.offsets3[:, :d] = self.offsets
        there = self.place[:, None, :] + self.offsets[None]
        self.present = (np.abs(there) <= self.extent).all(axis=-1)
        mirrored = there if s.rounding else np.abs(there)
        self.sign: Array = np.where(mirrored != there, -1.0, 1.0)
        self.neighbour: Indices = np.where(self.present, ((mirrored - low) * stride).sum(axis=-1), 0)
        self.held = np.abs(self.place[:, 0]) > half - s.inside
        self.free = np.broadcast_to(~self.held[:, None], self.place.shape).copy()
        self.images: Array = np.ones(len(self.X))
        if s.rounding:
            self.present &= self._rounded(half)
        else:
            self.free &= self.place != 0
            # Mirror images per point, for norms of the whole body.
            self.images = np.prod(np.where(self.place == 0, 1.0, 2.0), axis=1)
        self.pairs = list(self._groups(2)) if s.c2 else []
        self.triplets = list(self._groups(3)) if s.c3 else []
        self.part = 0.5 ** (np.abs(self.place) == self.extent).sum(axis=1) if s.halved else np.ones(len(self.X))
        self.V = [self._volume(k, groups) for k, groups in ((1, None), (2, self.pairs), (3, self.triplets))]

    def _rounded(self, half: int) -> NDArray[np.bool_]:
        """Who is a neighbour by the rounded distance of rounded coordinates."""
        s = self.s
        h = self.h
        count = np.arange(-s.outside, s.cells + s.outside + 1)
        if s.rounding.startswith("product"):
            axis = count * h
        elif s.rounding.startswith("shifted"):
            axis = -s.outside * h + np.arange(len(count)) * h
        elif s.rounding.startswith("centred"):
            axis = (count - half) * h
        elif s.rounding.startswith("quotient"):
            axis = count / s.cells
        elif s.rounding.startswith("linspace"):
            axis = np.linspace(-s.outside * h, 1.0 + s.outside * h, len(count))
        else:
            axis = np.cumsum(np.r_[-s.outside * h, np.full(len(count) - 1, h)])
        x = axis[self.place + half + s.outside]
        square = ((x[self.neighbour] - x[:, None]) ** 2).sum(axis=-1)
        delta = s.horizon * h
        within = square <= delta**2 if s.rounding.endswith("squares") else np.sqrt(square) <= delta
        return np.asarray(within)

    def _groups(self, size: int) -> Iterator[tuple[int, ...]]:
        o = self.offsets.astype(float)
        for group in combinations(range(len(o)), size):
            if self.s.mutual and any(((o[p] - o[q]) ** 2).sum() > self.s.horizon**2 for p, q in combinations(group, 2)):
                continue
            edges = o[list(group)]
            if np.linalg.det(edges @ edges.T) > 0.5:
                yield group

    def _volume(self, k: int, groups: list[tuple[int, ...]] | None) -> Array:
        """V_k, the volume that one neighbour, ordered pair or ordered triplet stands for, at every point."""
        s, d, count = self.s, self.s.dimension, len(self.offsets)
        weights = (s.weights.split("+") * 2)[0 if k == 1 else 1]
        if groups is not None and not groups:
            return np.zeros(len(self.X))
        delta = s.horizon * self.h
        ball = pi * delta**2 if d == 2 else 4.0 / 3.0 * pi * delta**3
        ordered = {1: 1, 2: 2, 3: 6}[k]
        singles = [(p,) for p in range(count)] if groups is None else groups
        bulk = ordered * len(singles)
        one = np.ones(len(self.X))
        if weights == "uniform":
            return ball**k / bulk * one
        if weights == "product":
            return (ball / count) ** k * one
        if weights == "cells":
            return self.h ** (d * k) * one
        if weights == "ball":
            return ball / bulk * one
        power = {"own": 0, "beta": 1, "beta2": 2, "code": 1}.get(weights, k)
        own = ordered * sum(self.present[:, list(group)].all(axis=1).astype(float) for group in singles)
        part = (self.present.sum(axis=1) / count) ** power
        whole = ball if weights == "code" else ball**k
        return np.where(own > 0, whole * part / np.maximum(own, 1.0), 0.0)

    def bonds(self, x: Array) -> Array:
        return self.sign * x[self.neighbour] - x[:, None, :]

    def residual(self, x: Array) -> tuple[Array, Array]:
        """R of every point, and its derivatives by the bonds xi of the point."""
        s, d, P = self.s, self.s.dimension, self.present
        Xi, xi = np.zeros((*P.shape, 3)), np.zeros((*P.shape, 3))
        Xi[..., :d] = self.offsets * self.h
        xi[..., :d] = self.bonds(x)
        R, G = np.zeros((len(x), 3)), np.zeros((*P.shape, 3, 3))
        L = np.linalg.norm(Xi, axis=-1)
        xi[~P] = Xi[~P]
        m, M = self.radial(xi, L, s.n)
        w = s.c1 * s.factors[0] * self.V[0][:, None] * P * self.part[self.neighbour]
        R += (w[..., None] * m).sum(axis=1)
        G += w[..., None, None] * M
        self._areas(R, G, xi)
        self._volumes(R, G, xi)
        return R[:, :d], G[..., :d, :d]

    def _areas(self, R: Array, G: Array, xi: Array) -> None:
        s = self.s
        for i, j in self.pairs:
            at = np.flatnonzero(self.present[:, i] & self.present[:, j])
            p, q = xi[at, i], xi[at, j]
            A = np.linalg.norm(np.cross(self.offsets3[i], self.offsets3[j])) * self.h**2
            m, M = self.radial(np.cross(p, q), A, s.n)
            # Both orders of the pair, each with the factor 2 of (19).
            w = 2.0 * s.c2 * s.factors[1] * self.V[1][at]
            R[at] += w[:, None] * np.cross(q - p, m)
            turn, spin = cross(q - p) @ M, cross(m)
            G[at, i] += w[:, None, None] * (spin - turn @ cross(q))
            G[at, j] += w[:, None, None] * (turn @ cross(p) - spin)

    def _volumes(self, R: Array, G: Array, xi: Array) -> None:
        s = self.s
        for i, j, k in self.triplets:
            at = np.flatnonzero(self.present[:, i] & self.present[:, j] & self.present[:, k])
            p, q, r = xi[at, i], xi[at, j], xi[at, k]
            V = float(np.linalg.det(self.offsets3[[i, j, k]])) * self.h**3
            qr, rp, pq = np.cross(q, r), np.cross(r, p), np.cross(p, q)
            first, second = self.scalar((p * qr).sum(axis=-1) / V, s.n)
            # Six orders of the triplet, each with the factor 3 of (19); V and v change sign together.
            w = 6.0 * s.c3 * s.factors[2] * self.V[2][at]
            stress, stiff = w * first * np.sign(V), w * second / abs(V)
            c = qr + rp + pq
            R[at] += stress[:, None] * c
            for one, dv, edge in ((i, qr, r - q), (j, rp, p - r), (k, pq, q - p)):
                G[at, one] += stiff[:, None, None] * c[:, :, None] * dv[:, None, :] + stress[:, None, None] * cross(
                    edge
                )

    def tangent(self, G: Array) -> Any:
        """Of the free unknowns, from the derivatives by bonds."""
        d, (M, N) = self.s.dimension, self.present.shape
        number = np.full(M * d, -1, dtype=np.int64)
        number[self.free.ravel()] = np.arange(self.free.sum())
        row = np.broadcast_to(np.arange(M)[:, None, None, None] * d + np.arange(d)[:, None], (M, N, d, d))
        column = np.broadcast_to(self.neighbour[:, :, None, None] * d + np.arange(d), (M, N, d, d))
        own = np.broadcast_to(np.arange(M)[:, None, None, None] * d + np.arange(d), (M, N, d, d))
        values = np.concatenate([(G * self.sign[:, :, None, :]).ravel(), -G.ravel()])
        rows = number[np.concatenate([row.ravel(), row.ravel()])]
        columns = number[np.concatenate([column.ravel(), own.ravel()])]
        kept = (rows >= 0) & (columns >= 0) & (values != 0.0)
        size = int(self.free.sum())
        return coo_matrix((values[kept], (rows[kept], columns[kept])), shape=(size, size)).tocsc()


def norm(body: Body, R: Array) -> float:
    """Of the free unknowns of the whole body."""
    return float(np.sqrt((body.images[:, None] * np.where(body.free, R, 0.0) ** 2).sum()))


def clamp(body: Body, x: Array, t: float) -> Array:
    """Moves the held points: by t X, or by what the box's own face moves."""
    moved = x.copy()
    at = 0.5 if body.s.rigid else body.X[body.held, 0]
    moved[body.held, 0] = body.X[body.held, 0] + t * at
    return moved


def extension(
    s: Settings,
    end: float = 1.0,
    columns: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0),
    most: int = 25,
) -> tuple[dict[str, list[float]], Body, Array]:
    """Newton's method with full steps from the last equilibrium: residuals over the first one, per column."""
    body = Body(s)
    x = body.X.copy()
    found: dict[str, list[float]] = {}
    steps = round(end / s.increment)
    for step in range(1, steps + 1):
        t = step * s.increment
        x = clamp(body, x, t)
        told: list[float] = []
        for _ in range(most):
            R, G = body.residual(x)
            told.append(norm(body, R))
            if not np.isfinite(told[-1]) or told[-1] > 1e6 * told[0]:
                return found, body, x
            if (len(told) > 5 and told[-1] < 1e-11 * told[0]) or told[-1] < 1e-13 * told[0]:
                break
            step_of = splu(
                body.tangent(G), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.01
            ).solve(-R[body.free])
            x[body.free] += step_of
        else:
            return found, body, x
        for column in columns:
            if abs(t - column) < 1e-9:
                found[f"{column:g}"] = [one / told[0] for one in told]
    return found, body, x
