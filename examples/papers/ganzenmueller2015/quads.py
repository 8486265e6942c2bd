"""A square cut into 444 quadrilaterals at random: the construction that the paper names for its cloud.

Points at random are moved to the centres of their Voronoi cells (Lloyd), joined to 888 triangles (Delaunay), and
these are joined in pairs to quadrilaterals, all of them and as square as can be: a perfect matching of largest
weight, found by an integer program. `python quads.py` from the folder of the papers' program writes `patch.msh`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.optimize
import scipy.sparse
import scipy.spatial
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

SIDE = 20
"""Intervals along an edge of the square: 80 points on it, and 405 inside, make 888 triangles."""
INSIDE = 405


def points(seed: int, rounds: int) -> Array:
    """Points on the edge, evenly, and inside, after some rounds of Lloyd."""
    inside = np.random.default_rng(seed).uniform(0.02, 0.98, (INSIDE, 2))
    s = np.arange(SIDE) / SIDE
    edge = np.concatenate(
        [np.stack(one, 1) for one in ((s, 0 * s), (1 + 0 * s, s), (1 - s, 1 + 0 * s), (0 * s, 1 - s))]
    )
    for _ in range(rounds):
        # Samples of the square go to the nearest point; points go to the means of theirs.
        grid = (np.stack(np.meshgrid(np.arange(400), np.arange(400)), -1).reshape(-1, 2) + 0.5) / 400
        nearest = scipy.spatial.cKDTree(np.concatenate([edge, inside])).query(grid)[1] - len(edge)
        mine = nearest >= 0
        count = np.bincount(nearest[mine], minlength=INSIDE)
        inside = np.stack([np.bincount(nearest[mine], grid[mine, a], INSIDE) / count for a in (0, 1)], 1)
    return np.concatenate([edge, inside])


def quality(corners: Array) -> float:
    """1 for angles of 90 degrees; not positive where a quadrilateral is not convex."""
    a, b = np.roll(corners, -1, 0) - corners, np.roll(corners, 1, 0) - corners
    sine = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / np.sqrt((a**2).sum(1) * (b**2).sum(1))
    return float(sine.min())


def quadrilaterals(x: Array) -> Whole:
    """Corners of the quadrilaterals, counterclockwise."""
    triangles = scipy.spatial.Delaunay(x)
    flat = triangles.simplices
    a, b = x[flat[:, 1]] - x[flat[:, 0]], x[flat[:, 2]] - x[flat[:, 0]]
    turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    flat = np.where(turned[:, None], flat[:, [0, 2, 1]], flat)
    pairs, corners, gain = [], [], []
    for t, neighbours in enumerate(triangles.neighbors):
        for u in (u for u in neighbours if u > t):
            # The corner of t that u has not, then round: over the common edge lies that of u.
            (first,) = [k for k in range(3) if flat[t, k] not in flat[u]]
            (other,) = [v for v in flat[u] if v not in flat[t]]
            quad = [flat[t, first], flat[t, (first + 1) % 3], other, flat[t, (first + 2) % 3]]
            good = quality(x[quad])
            if good > 0.0:
                pairs.append((t, u))
                corners.append(quad)
                gain.append(good)
    ends = np.array(pairs)
    meets = scipy.sparse.csr_matrix(
        (np.ones(2 * len(pairs)), (ends.T.ravel(), np.tile(np.arange(len(pairs)), 2))), (len(flat), len(pairs))
    )
    found = scipy.optimize.milp(
        -np.array(gain),
        constraints=scipy.optimize.LinearConstraint(meets, 1, 1),
        integrality=np.ones(len(pairs)),
        bounds=scipy.optimize.Bounds(0, 1),
    )
    assert found.x is not None, "the triangles cannot be joined in pairs"
    chosen: Whole = np.array(corners)[found.x > 0.5]
    return chosen


def write(path: Path, x: Array, quads: Whole) -> None:
    """A mesh of Gmsh, version 2.2."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(x))]
    lines += [f"{k + 1} {p[0]:.12g} {p[1]:.12g} 0" for k, p in enumerate(x)]
    lines += ["$EndNodes", "$Elements", str(len(quads))]
    lines += [f"{k + 1} 3 2 1 1 " + " ".join(str(v + 1) for v in one) for k, one in enumerate(quads)]
    path.write_text("\n".join([*lines, "$EndElements"]) + "\n", encoding="utf-8")


def read(path: Path) -> tuple[Array, Whole]:
    """Nodes and quadrilaterals of such a mesh."""
    lines = path.read_text(encoding="utf-8").splitlines()
    at, to = lines.index("$Nodes"), lines.index("$Elements")
    x = np.array([[float(word) for word in line.split()[1:3]] for line in lines[at + 2 : lines.index("$EndNodes")]])
    quads = [[int(word) - 1 for word in line.split()[5:]] for line in lines[to + 2 : lines.index("$EndElements")]]
    return x, np.array(quads)


if __name__ == "__main__":
    # The first numbers tried for which all triangles find a partner with which they are convex.
    nodes = points(seed=2017, rounds=12)
    write(Path(__file__).with_name("patch.msh"), nodes, quadrilaterals(nodes))
