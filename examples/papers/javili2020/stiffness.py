"""Fig. 7: the pattern of the stiffness matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from running import Run
from study import Claim, Found, Map, Row, figure

PAPER = "javili2020"
HOLE = "max(abs(X - 0.5), abs(Y - 0.5)) < 0.2 - 1e-5"
BODIES = {"full": False, "with hole": True}
HORIZONS = (2, 3, 4)
# Pixels of a picture along an edge, at most.
PIXELS = 320
# Points whose forces are differentiated, and by which part of a spacing they are moved.
BLOCK = 12
STEP = 1e-4
# What differences leave: the square of the step, and u over it.
SYMMETRIC = 1e-7

Array = NDArray[np.float64]


class Matrix:
    """The stiffness at rest of a square with its points, bonds alone or with triangles."""

    def __init__(self, run: Run, cells: int, m: int, hole: bool, k2: float = 0.0) -> None:
        spacing = 1.0 / cells
        body = run.scene("square.toml", {
            "body.spacing": spacing,
            "body.remove": [HOLE] if hole else [],
            "horizon.spacings": m,
            "material.parameters.C2": k2 / (m * spacing) ** 3,
        }).body()
        self.X: Array = body.positions
        self.K: Any = body.energy().tangent().tocsr()
        self._body = body
        self._step = STEP * spacing

    def asymmetry(self) -> float:
        """Largest difference from the transpose, over the largest entry, of a block of derivatives of forces by
        central differences: the matrix itself is stored as one half."""
        middle = int(np.argmin(np.abs(self.X - 0.25).sum(1)))
        near = np.argsort(np.abs(self.X - self.X[middle]).sum(1), kind="stable")[:BLOCK]
        rows = (2 * near[:, None] + np.arange(2)).flatten()

        def derivative(component: int) -> Array:
            u = np.zeros(self.X.size)
            u[component] = self._step
            there, back = (self._body.energy(way * u.reshape(self.X.shape)).gradient.flatten() for way in (1.0, -1.0))
            found: Array = (there - back)[rows] / (2.0 * self._step)
            return found

        block = np.stack([derivative(int(component)) for component in rows], axis=1)
        return float(np.abs(block - block.T).max() / np.abs(block).max())

    def entries(self) -> int:
        """Entries that are not zero."""
        return int(np.count_nonzero(self.K.data))

    def reach(self) -> NDArray[np.int64]:
        """How far the entries of each row reach from the diagonal."""
        kept = self.K.tocoo()
        found = np.zeros(self.K.shape[0], dtype=np.int64)
        some = kept.data != 0.0
        np.maximum.at(found, kept.row[some], np.abs(kept.row[some] - kept.col[some]))
        return found

    def picture(self) -> list[list[float]]:
        """log10 of the largest |K_ij| of a block of entries over the largest; rows go down as in a matrix."""
        size = self.K.shape[0]
        block = -(-size // PIXELS)
        shown = np.zeros((-(-size // block),) * 2)
        kept = self.K.tocoo()
        np.maximum.at(shown, (kept.row // block, kept.col // block), np.abs(kept.data))
        with np.errstate(divide="ignore"):
            logarithm = np.log10(shown / shown.max())
        logarithm[logarithm < -8.0] = np.nan
        return [[float(one) for one in row] for row in logarithm[::-1]]


def pointwise_asymmetry(run: Run, spacing_cells: int, m: int) -> float:
    """The same where every point divides the whole ball of the horizon among the neighbours that it has."""
    matrix = Matrix(run, spacing_cells, m, False)
    points = matrix.K.tocoo()
    pairs = np.unique(np.stack([points.row // 2, points.col // 2]), axis=1)
    neighbours = np.bincount(pairs[0]) - 1
    scaled = matrix.K.multiply(1.0 / np.repeat(neighbours, 2)[:, None]).tocsr()
    return float(abs(scaled - scaled.T).max() / abs(scaled).max())


@figure(PAPER, "Fig. 7", "pattern of the stiffness matrix")
def fig07(run: Run) -> Found:
    all_cells = (20, 50) if run.full else (20,)
    found = {
        (cells, body, m): Matrix(run, cells, m, hole)
        for cells in all_cells for body, hole in BODIES.items() for m in HORIZONS
    }
    rows: list[Row] = []
    for cells in all_cells:
        ours = {(body, m): found[cells, body, m] for body in BODIES for m in HORIZONS}
        rows += [about(cells, ours, row) for row in range(3)]
    if run.full:
        sizes = [found[cells, "full", 3].K.shape[0] for cells in all_cells]
        bands = [found[cells, "full", 3].reach().max() / size for cells, size in zip(all_cells, sizes, strict=True)]
        rows.append(Claim(
            "the finer spacing has the larger matrix",
            "much larger for 0.02 than for 0.05, though it looks narrower",
            f"{sizes[1]} rows against {sizes[0]}; with 3 spacings entries reach {bands[1]:.3f} and {bands[0]:.3f} of "
            "the size from the diagonal",
            bool(sizes[1] > 2 * sizes[0] and bands[1] < bands[0]),
            cheap=False,
        ))
    areas = max(Matrix(run, 20, 3, hole, 1.0).asymmetry() for hole in BODIES.values())
    rows.append(Claim(
        "symmetry with triangles, too", "the parts of K of two neighbours are symmetric",
        f"differences of forces differ from their transpose by {areas:.0e} of the largest at C2 delta^3/C1 = 1",
        areas < SYMMETRIC,
    ))
    own = pointwise_asymmetry(run, 20, 3)
    panels = [
        Map(
            f"spacing {1.0 / cells:g}, {body}, horizon {m} spacings", one.picture(), "log10 |K| over largest",
            (-2.5, 0.0),
        )
        for (cells, body, m), one in found.items()
    ]
    notes = f"""The paper does not say which horizons it draws, whether points lie on the edges, or how they are
    numbered: here horizons of 2, 3 and 4 spacings, points on the edges, numbered along Y first, with bonds alone.
    Entries that one pixel covers are drawn by the largest. A stiffness that is the second derivative of an energy
    is symmetric; the residual (39) of a point with effective volumes of its own is symmetric only if beta of eq.
    (29) is in proportion to the number of neighbours, so that V1 is the same everywhere. With beta = 1 at every
    point K and its transpose differ by {own:.2f} of the largest entry (spacing 0.05, horizon of 3 spacings)."""
    return Found(rows, list(panels), notes, columns=3)


def about(cells: int, ours: dict[tuple[str, int], Matrix], row: int) -> Claim:
    """One of three statements at a spacing."""
    spacing, cheap = f"spacing {1.0 / cells:g}", cells == 20
    if row == 0:
        worst = max(one.asymmetry() for one in ours.values())
        return Claim(
            f"{spacing}: symmetry", "K is symmetric in all cases",
            f"differences of forces differ from their transpose by {worst:.0e} of the largest", worst < SYMMETRIC,
            cheap=cheap,
        )
    if row == 1:
        entries = {body: [ours[body, m].entries() for m in HORIZONS] for body in BODIES}
        reach = {body: [int(ours[body, m].reach().max()) for m in HORIZONS] for body in BODIES}
        told = "; ".join(f"{body}: {entries[body]} entries, band {reach[body]}" for body in BODIES)
        grow = all(
            one < other for found in (entries, reach) for body in BODIES
            for one, other in zip(found[body][:-1], found[body][1:], strict=True)
        )
        return Claim(
            f"{spacing}: larger horizons", "give a wider band and more entries",
            f"horizons of {', '.join(map(str, HORIZONS))} spacings: {told}", grow, cheap=cheap,
        )
    widths = []
    for m in HORIZONS:
        near = [np.abs(ours[body, m].X[:, 0] - 0.5) < 0.2 - m / cells for body in BODIES]
        widths.append([
            int(ours[body, m].reach()[np.repeat(here, 2)].max())
            for body, here in zip(BODIES, near, strict=True) if here.any()
        ])
    widths = [one for one in widths if len(one) == 2]
    return Claim(
        f"{spacing}: beside the hole", "the band is narrower there",
        "; ".join(f"{one[0]} without and {one[1]} with the hole" for one in widths),
        all(one[1] < one[0] for one in widths), cheap=cheap,
    )
