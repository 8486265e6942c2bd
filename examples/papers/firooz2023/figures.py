"""firooz2023: continuum-kinematics-inspired peridynamics with hyper-dual numbers."""

from __future__ import annotations

# Studies enter themselves.
from firooz2023 import derivatives, horizons, shapes, tension  # noqa: F401
from study import drawing

PAPER = "firooz2023"

drawing(PAPER, "Fig. 1", "kinds of differentiation, approximate ones and exact ones")
drawing(PAPER, "Fig. 2", "a body, its horizon, and the lengths, areas and volumes between neighbours")
drawing(PAPER, "Table 1", "the notation")
drawing(PAPER, "Table 2", "which derivatives of the energies the residual and the tangent take")
drawing(PAPER, "Table 9", "the number systems and the squares of their units")
