"""miranda: fast interaction functions for bond-based peridynamics (Miranda, Orr, Williams)."""

from __future__ import annotations

from miranda import beams, counts, crushed, plate, reinforced, speed, stretches
from running import Run
from study import Found, drawing, figure

PAPER = "miranda"

figure(PAPER, "Fig. 1", "the modified stretch against the stretch")(stretches.fig01)
drawing(PAPER, "Fig. 2", "the beam of the benchmark: its section and how it is pulled")
figure(PAPER, "Fig. 3", "points and bonds of all models of sections 4 and 5.1")(counts.fig03)
drawing(PAPER, "Fig. 4", "the two beams of section 5.1.1")
drawing(PAPER, "Fig. 5", "the load of the beams against time")
drawing(PAPER, "Fig. 6", "the points of the clamped beam, as in Fig. 3")


@figure(PAPER, "Fig. 7", "deflection of the clamped beam")
def fig07(run: Run) -> Found:
    return beams.contour(run, True)


figure(PAPER, "Fig. 8", "deflection of the clamped beam along its axis")(beams.clamped_curves)


@figure(PAPER, "Fig. 9", "deflection of the cantilever")
def fig09(run: Run) -> Found:
    found = beams.contour(run, False)
    found.rows += beams.steps_in_time(run)
    return found


figure(PAPER, "Fig. 10", "deflection of the cantilever along its axis")(beams.cantilever_curves)
drawing(PAPER, "Fig. 11", "the plate that is built in at three edges")
drawing(PAPER, "Fig. 12", "the load of the plate against time")
figure(PAPER, "Fig. 13", "deflection of the plate, by finite elements and by bonds")(plate.fig13)
figure(PAPER, "Fig. 14", "deflection of the plate across the free edge")(plate.fig14)
figure(PAPER, "Fig. 15", "deflection of the plate along the free edge")(plate.fig15)
drawing(PAPER, "Fig. 16", "the reinforced beam with its supports")
figure(PAPER, "Fig. 17", "damage of the reinforced beam at 0.37 of 20 mm")(reinforced.fig17)
figure(PAPER, "Fig. 18", "the reinforced beam at 0.79 of 20 mm")(reinforced.fig18)
figure(PAPER, "Fig. 19", "the reinforced beam at 0.79 of 20 mm, its side")(reinforced.fig19)
drawing(PAPER, "Fig. 20", "a photograph of a beam that failed in a laboratory")
figure(PAPER, "Fig. 21", "points and bonds of the cube and of the reinforced beam")(counts.fig21)
figure(PAPER, "Fig. 22", "stress against strain of a cube of concrete")(crushed.fig22)
figure(PAPER, "Fig. 23", "damage of the cube under compression")(crushed.fig23)
drawing(PAPER, "Fig. 24", "cracks of cubes in a laboratory")
figure(PAPER, "Table 1", "bonds per point by the horizon")(counts.table01)
figure(PAPER, "Table 2", "time with the stretch and with the modified stretch")(speed.table02)
drawing(PAPER, "Table 3", "the material of section 5.1: what goes in")
drawing(PAPER, "Table 4", "the materials of the reinforced beam: what goes in")
