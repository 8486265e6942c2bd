"""Local linear elasticity of the squares by finite elements (scikit-fem), the limit of small horizons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def square(cells: int, hole: bool, strain: float, held: bool = True) -> dict[str, Array]:
    """Nodes and displacements in m of a unit square whose ends are moved apart, at lambda = mu.

    Biquadratic elements, `cells` along an edge; in the plane, where nothing happens across it. Ends are held
    across the extension, or slide with the middle of the square held.
    """
    import skfem
    from skfem.models.elasticity import linear_elasticity

    ticks = np.linspace(0.0, 1.0, cells + 1)
    mesh = skfem.MeshQuad.init_tensor(ticks, ticks)
    if hole:
        mesh = mesh.remove_elements(mesh.elements_satisfying(lambda x: np.max(np.abs(x - 0.5), axis=0) < 0.2))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()))
    stiffness = linear_elasticity(1.0, 1.0).assemble(basis)
    places = basis.doflocs
    ends = basis.get_dofs(lambda x: (x[0] < 1e-9) | (x[0] > 1.0 - 1e-9))
    along, across = ends.all(["u^1"]), ends.all(["u^2"])
    if not held:
        middle = np.flatnonzero(np.abs(places - 0.5).max(axis=0) < 1e-9)
        across = np.array([dof for dof in middle if dof in set(basis.nodal_dofs[1])])
    u = np.zeros(basis.N)
    u[along] = strain * places[0, along]
    u = skfem.solve(*skfem.condense(stiffness, x=u, D=np.concatenate([along, across])))
    return {"X": mesh.p.T.copy(), "u": u[basis.nodal_dofs].T.copy()}


def ratio_at_centre(cells: int, held: bool) -> float:
    """Lateral contraction over extension of the full square, by central differences over 0.05 m."""
    found = square(cells, False, 1e-3, held)

    def at(axis: int, sign: int) -> float:
        place = np.array([0.5, 0.5])
        place[axis] += 0.05 * sign
        return float(found["u"][np.argmin(np.abs(found["X"] - place).sum(axis=1)), axis])

    return -(at(1, 1) - at(1, -1)) / (at(0, 1) - at(0, -1))
