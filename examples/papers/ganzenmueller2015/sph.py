"""The paper's sums as they are printed: SPH, peridynamics of psi(F) at points, Algorithm 1. A program beside piola."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ganzenmueller2015.families import Array, Families


def cubic_spline(r: Array, horizon: float, d: int) -> Array:
    """A weight function W of SPH that ends at the horizon, 1/m^d; its integral is 1."""
    q = r / horizon
    scale = {2: 40.0 / (7.0 * np.pi), 3: 8.0 / np.pi}[d] / horizon**d
    found: Array = scale * np.where(q <= 0.5, 1.0 - 6.0 * q**2 + 6.0 * q**3, 2.0 * np.maximum(1.0 - q, 0.0) ** 3)
    return found


def spline_slope(r: Array, horizon: float, d: int) -> Array:
    """Its derivative dW/dr."""
    q = r / horizon
    scale = {2: 40.0 / (7.0 * np.pi), 3: 8.0 / np.pi}[d] / horizon ** (d + 1)
    found: Array = scale * np.where(q <= 0.5, -12.0 * q + 18.0 * q**2, -6.0 * np.maximum(1.0 - q, 0.0) ** 2)
    return found


def st_venant_kirchhoff(F: Array, lame: float, mu: float) -> Array:
    """P = F S of points (Algorithm 1, lines 16 to 18), with the unit tensor that line 17 leaves out."""
    d = F.shape[-1]
    E = (np.swapaxes(F, 1, 2) @ F - np.eye(d)) / 2.0
    S = lame * np.trace(E, axis1=1, axis2=2)[:, None, None] * np.eye(d) + 2.0 * mu * E
    found: Array = F @ S
    return found


def as_printed(F: Array, lame: float, mu: float) -> Array:
    """Line 17 to the letter: the trace is added to every component of S."""
    d = F.shape[-1]
    E = (np.swapaxes(F, 1, 2) @ F - np.eye(d)) / 2.0
    S = lame * np.trace(E, axis1=1, axis2=2)[:, None, None] + 2.0 * mu * E
    found: Array = F @ S
    return found


def energy(F: Array, V: Array, lame: float, mu: float) -> float:
    """Of all points, J."""
    E = (np.swapaxes(F, 1, 2) @ F - np.eye(F.shape[-1])) / 2.0
    trace = np.trace(E, axis1=1, axis2=2)
    return float((V * (lame / 2.0 * trace**2 + mu * (E**2).sum((1, 2)))).sum())


class Sph:
    """Sums over families of SPH with a given dW/dr of every pair (section 2)."""

    def __init__(self, f: Families, slope: Array) -> None:
        self.f = f
        length = np.sqrt((f.X**2).sum(1))
        self.gradW = slope[:, None] * f.X / length[:, None]
        """Eq. 9."""
        self.V = f.V[f.j]
        L = f.gather(self.V[:, None, None] * self.gradW[:, :, None] * f.X[:, None, :])
        self.L = L
        """Eq. 15."""
        self.corrected = np.einsum("nab,nb->na", np.linalg.inv(L)[f.i], self.gradW)
        """Eq. 14."""

    def plain(self, values: Array) -> Array:
        """Eq. 8: the gradient of values at points, without any correction."""
        return self.f.gather(self.V[:, None, None] * values[self.f.j][:, :, None] * self.gradW[:, None, :])

    def symmetrised(self, values: Array) -> Array:
        """Eq. 12."""
        change = self.f.difference(values)
        return self.f.gather(self.V[:, None, None] * change[:, :, None] * self.gradW[:, None, :])

    def complete(self, values: Array) -> Array:
        """Eq. 17 without I, the corrected gradient."""
        change = self.f.difference(values)
        return self.f.gather(self.V[:, None, None] * change[:, :, None] * self.corrected[:, None, :])

    def _force(self, pull: Array) -> Array:
        f = self.f
        return f.gather((f.V[f.i] * f.V[f.j])[:, None] * pull)

    def forces_18(self, P: Array, gradient: Array) -> Array:
        """Eq. 18 with a kernel gradient: N (per metre of thickness in the plane)."""
        return self._force(np.einsum("nab,nb->na", P[self.f.i] + P[self.f.j], gradient))

    def forces_21(self, P: Array) -> Array:
        """Eq. 21: each stress with the corrected gradient of its own point."""
        PL = P @ np.linalg.inv(self.L)
        return self.forces_18(PL, self.gradW)


def peridynamic_forces(f: Families, P: Array) -> Array:
    """Eq. 35, whose sum runs over the family of i for both terms."""
    PK = P @ np.linalg.inv(f.shape())
    pull = np.einsum("nab,nb->na", PK[f.i] + PK[f.j], f.X)
    return f.gather((f.w * f.V[f.i] * f.V[f.j])[:, None] * pull)


def conservative_forces(f: Families, P: Array) -> Array:
    """Minus the derivatives of the energy: each force state acts on its point and, with the other sign, on the
    neighbour, also where that has not the point in its family. Where families are mutual that is eq. 35."""
    PK = P @ np.linalg.inv(f.shape())
    pull = (f.w * f.V[f.i] * f.V[f.j])[:, None] * np.einsum("nab,nb->na", PK[f.i], f.X)
    back = np.stack([np.bincount(f.j, one, f.n) for one in pull.T], axis=-1)
    found: Array = f.gather(pull) - back
    return found


def leap_frog(
    x: Array, acceleration: Callable[[Array], Array], step: float, steps: int, seen: Callable[[int, Array, Array], None]
) -> Array:
    """From rest; `seen` gets positions, and velocities half a step earlier, before every step. Ends with positions."""
    v = np.zeros_like(x)
    for k in range(steps):
        a = acceleration(x)
        seen(k, x, v)
        v = v + (step / 2.0 if k == 0 else step) * a
        x = x + step * v
    return x
