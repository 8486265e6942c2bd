"""The stiffness of psi(F) at points at rest, summed up family by family: a program beside piola."""

from __future__ import annotations

import numpy as np

from ganzenmueller2015.families import Array, Families


def tangent(f: Families, lame: float, mu: float) -> Array:
    """Second derivatives of the energy by the displacements of the points in turn (x, y, x, ..), N/m^2."""
    d = len(f.slopes)
    # What each component of a displacement does to each component of its gradient.
    H = np.zeros((d, d, f.n, f.n, d))
    for a in range(d):
        for b in range(d):
            H[a, b, :, :, a] = f.slopes[b].toarray()
    E = 0.5 * (H + H.transpose(1, 0, 2, 3, 4)).reshape(d * d, f.n, f.n * d)
    trace = E[:: d + 1].sum(axis=0)
    found: Array = lame * trace.T @ (f.V[:, None] * trace)
    for part in E:
        found += 2.0 * mu * part.T @ (f.V[:, None] * part)
    return found


def spectrum(f: Families, lame: float, mu: float) -> Array:
    """Eigenvalues over the masses at 1 kg/m^3, 1/s^2, from the lowest."""
    mass = np.repeat(f.V, f.X.shape[1])
    found: Array = np.asarray(np.linalg.eigvalsh(tangent(f, lame, mu) / np.sqrt(np.outer(mass, mass))), dtype=float)
    return found
