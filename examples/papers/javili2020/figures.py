"""javili2020: a computational framework for continuum-kinematics-inspired peridynamics."""

from __future__ import annotations

# Studies enter themselves.
from javili2020 import convergence, finite, poisson, stiffness, stretch  # noqa: F401
from study import drawing

PAPER = "javili2020"

drawing(PAPER, "Table 1", "the balance equations of local continuum mechanics and of continuum-kinematics peridynamics")
drawing(PAPER, "Table 2", "formulas of force densities, measures and energies of bonds, triangles and tetrahedra")
drawing(PAPER, "Fig. 1", "the motion of a body and of the neighbourhood of a point")
drawing(PAPER, "Fig. 2", "which pairs of neighbours count as contributing")
drawing(PAPER, "Fig. 3", "finer spacings in one horizon beside smaller horizons of as many spacings")
drawing(PAPER, "Fig. 4", "the two specimens of section 4.1 and how they are extended")
drawing(PAPER, "Fig. 10", "the two squares of section 4.4 and how they are extended")
drawing(PAPER, "Fig. 13", "the two cubes of section 4.4 and how they are extended")
drawing(PAPER, "Fig. 16", "triangles of one area and pyramids of one volume whose edges differ")
