"""ganzenmueller2015: total Lagrangian SPH and peridynamics of psi(F) at points, and what both lack."""

from __future__ import annotations

# Studies enter themselves.
from ganzenmueller2015 import algorithm, beam, equations, modes, patch  # noqa: F401
from ganzenmueller2015.families import PAPER
from study import drawing

drawing(PAPER, "Fig. 1", "a point with its neighbourhood, the horizon and a bond")
drawing(PAPER, "Fig. 4", "the beam on its supports with its length and height")
