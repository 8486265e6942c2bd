"""The solids of section 5.1 by the theory of beams, and by finite elements in three dimensions (scikit-fem)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem.helpers import ddot, eye, sym_grad, trace

Vector = NDArray[np.float64]

E = 20e9
"""Young's modulus in Pa, Table 3."""
NU = 0.25
LOAD = 10e3
"""Of the beams, N/m."""
SPAN = 3.5
"""Of both beams between what is held, m: 70 spacings."""


@dataclass
class Section:
    """Of a beam, width and height in m."""

    width: float
    height: float

    def euler_bernoulli(self, held_at_both_ends: bool, s: Vector) -> Vector:
        """Deflection in m at the distance s from the support."""
        stiffness = E * self.width * self.height**3 / 12.0
        if held_at_both_ends:
            return np.asarray(LOAD * s**2 * (SPAN - s) ** 2 / (24.0 * stiffness))
        return np.asarray(LOAD * s**2 * (6.0 * SPAN**2 - 4.0 * SPAN * s + s**2) / (24.0 * stiffness))

    def timoshenko(self, held_at_both_ends: bool, s: Vector) -> Vector:
        """With the deflection by shear, of the factor 5/6."""
        shear = 5.0 / 6.0 * E / (2.0 * (1.0 + NU)) * self.width * self.height
        way = SPAN * s - s**2 if held_at_both_ends else 2.0 * SPAN * s - s**2
        return np.asarray(self.euler_bernoulli(held_at_both_ends, s) + LOAD * way / (2.0 * shear))


POINTS = Section(0.3, 0.4)
"""Between the outermost points."""
VOLUMES = Section(0.35, 0.45)
"""That the points' volumes fill."""


def deflections(size: tuple[float, float, float], cells: tuple[int, int, int], held: str, pressure: float,
                mirror: bool = False) -> Vector:
    """Of a block under a pressure in Pa on its upper face, in m at all nodes of its middle plane: rows x, y, w.

    `held` names the faces without displacements: "x", "xX" or "xy", small letters for the lower ones; with `mirror`
    the upper face along x is one of symmetry. Hexahedra of 27 nodes.
    """
    axes = [np.linspace(0.0, length, n + 1) for length, n in zip(size, cells, strict=True)]
    mesh = skfem.MeshHex.init_tensor(*axes)
    element = skfem.ElementVector(skfem.ElementHex2())
    basis = skfem.Basis(mesh, element, intorder=4)
    lame, shear = E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU)), E / (2.0 * (1.0 + NU))

    @skfem.BilinearForm  # type: ignore[untyped-decorator]
    def stiffness(u: Any, v: Any, _: Any) -> Any:
        strain = sym_grad(u)
        return ddot(lame * eye(trace(strain), 3) + 2.0 * shear * strain, sym_grad(v))

    @skfem.LinearForm  # type: ignore[untyped-decorator]
    def load(v: Any, _: Any) -> Any:
        return -pressure * v[2]

    top = mesh.facets_satisfying(lambda x: np.isclose(x[2], size[2]))
    force = load.assemble(skfem.FacetBasis(mesh, element, facets=top, intorder=4))
    # Components of a node follow each other.
    at, component = basis.doflocs, np.arange(basis.N) % 3
    fixed = mirror & (component == 0) & np.isclose(at[0], size[0])
    for face in held:
        k = "xyz".index(face.lower())
        fixed |= np.isclose(at[k], 0.0 if face.islower() else size[k])
    u = skfem.solve(*skfem.condense(stiffness.assemble(basis), force, D=np.flatnonzero(fixed)))
    shown = (component == 2) & np.isclose(at[2], size[2] / 2.0)
    return np.asarray([at[0][shown], at[1][shown], -u[shown]])
