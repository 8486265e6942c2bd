"""partmann2026: bond-associated modelling of fracture."""

from __future__ import annotations

# Studies enter themselves.
from partmann2026 import bar, checkerboard, equations, fracture, large  # noqa: F401
from partmann2026.published import PAPER
from study import drawing

drawing(PAPER, "Fig. 1", "a body at rest and deformed")
drawing(PAPER, "Fig. 2", "how the neighbourhood of a point deforms")
drawing(PAPER, "Fig. 3", "elements of lines, surfaces and volumes at rest and deformed")
drawing(PAPER, "Fig. 4", "a body under body forces and tractions")
drawing(PAPER, "Fig. 5", "a peridynamic body with the horizon of a point")
drawing(PAPER, "Fig. 6", "the part of a family that belongs to a bond in the model of Chen and Spencer")
drawing(PAPER, "Fig. 7", "points of quadrature in the middle of bonds")
drawing(PAPER, "Fig. 12", "the bar of section 5.1 with its load")
drawing(PAPER, "Fig. 15", "the plate of section 5.2 with its crack")
drawing(PAPER, "Fig. 17", "the plate of section 5.3 with its crack and its loads")
