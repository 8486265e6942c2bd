"""Pictures of points with the mesh behind them, as the paper draws them."""

from __future__ import annotations

import io

import matplotlib.pyplot as plt
import numpy as np
import scipy.spatial
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from ganzenmueller2015.families import Array
from ganzenmueller2015.quads import Whole


def neighbours(X: Array) -> Whole:
    """Edges of the Delaunay triangles at rest, without long ones along the boundary."""
    triangles = scipy.spatial.Delaunay(X).simplices
    sides = np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [0, 2])])
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    length = np.sqrt(((X[edges[:, 1]] - X[edges[:, 0]]) ** 2).sum(1))
    kept: Whole = edges[length < 2.0 * np.median(length)]
    return kept


def points_and_mesh(x: Array, edges: Whole, window: tuple[float, float] = (-0.05, 1.05)) -> bytes:
    """Points at `x` (m) and the lines between them."""
    chart, place = plt.subplots(figsize=(4.0, 4.0), layout="constrained")
    place.add_collection(LineCollection(list(x[edges]), colors="0.75", linewidths=0.5))
    place.plot(x[:, 0], x[:, 1], ".", ms=4.0, color="tab:blue")
    place.set_xlim(*window)
    place.set_ylim(*window)
    place.set_aspect("equal")
    place.axis("off")
    return _png(chart)


def points_and_quads(x: Array, quads: Array) -> bytes:
    """Points in the middle of quadrilaterals, whose corners are given."""
    chart, place = plt.subplots(figsize=(4.0, 4.0), layout="constrained")
    place.add_collection(PolyCollection(list(quads), facecolors="none", edgecolors="0.6", linewidths=0.6))
    place.plot(x[:, 0], x[:, 1], ".", ms=4.0, color="tab:blue")
    place.set_xlim(-0.02, 1.02)
    place.set_ylim(-0.02, 1.02)
    place.set_aspect("equal")
    place.axis("off")
    return _png(chart)


def stress(x: Array, values: Array, largest: float, frame: tuple[float, float, float, float], size: float) -> bytes:
    """Points at `x` (mm) with S_xx in GPa: red is tension, blue compression."""
    chart, place = plt.subplots(figsize=(4.4, 4.6), layout="constrained")
    shown = place.scatter(x[:, 0], x[:, 1], c=values, s=size, cmap="jet", vmin=-largest, vmax=largest, linewidths=0)
    place.set_xlim(frame[0], frame[1])
    place.set_ylim(frame[2], frame[3])
    place.set_aspect("equal")
    place.axis("off")
    chart.colorbar(shown, ax=place, shrink=0.7).set_label("S_xx, GPa", fontsize=7)
    return _png(chart)


def _png(chart: Figure) -> bytes:
    drawn = io.BytesIO()
    chart.savefig(drawn, dpi=110, format="png")
    plt.close(chart)
    return drawn.getvalue()
