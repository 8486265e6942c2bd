"""What quadrature at bonds stores, (4.21) to (4.27), on a lattice with the constant kernel: a program beside piola."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


def energies(u: Values, spacing: float, reach: float, lame: float, mu: float) -> Values:
    """J/m^3 at every point of a box, of displacements (a, b, c, 3) in m; the horizon is `reach` spacings."""
    shape = u.shape[:3]
    far = int(reach)
    family = [o for o in product(range(-far, far + 1), repeat=3) if 0 < sum(c * c for c in o) <= reach**2]
    count = np.zeros(shape)
    K, N = np.zeros((*shape, 3, 3)), np.zeros((*shape, 3, 3))
    for o in family:
        here, there = ends(shape, o)
        X = spacing * np.array(o)
        count[here] += 1.0
        K[here] += np.outer(X, X)
        N[here] += (u[there] - u[here])[..., None] * X
    # Of displacements, so that nothing cancels: F - 1.
    H = N @ np.linalg.inv(K)
    stored = np.zeros(shape)
    for o in family:
        here, there = ends(shape, o)
        X = spacing * np.array(o)
        mean = 0.5 * (H[here] + H[there])
        left = (u[there] - u[here]) - mean @ X
        h = mean + left[..., None] * X / (X @ X)
        e = 0.5 * (h + np.swapaxes(h, -1, -2) + np.swapaxes(h, -1, -2) @ h)
        density = 0.5 * lame * np.trace(e, axis1=-2, axis2=-1) ** 2 + mu * (e * e).sum(axis=(-2, -1))
        stored[here] += 0.5 * (1.0 / count[here] + 1.0 / count[there]) * density
    return stored


def ends(shape: tuple[int, ...], offset: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """All points that have a neighbour at this offset, and these neighbours."""
    here = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, shape, strict=True))
    there = tuple(slice(max(0, o), n - max(0, -o)) for o, n in zip(offset, shape, strict=True))
    return here, there


def alternating(n: int, amplitude: float) -> Values:
    """(4.44) at whole multiples of the spacing, n points along an edge, the middle one at the origin; in m."""
    sign = (-1.0) ** (np.arange(n) - n // 2)
    x, y, z = np.meshgrid(sign, sign, sign, indexing="ij")
    return amplitude * np.stack([y * z, x * z, x * y], axis=-1)
