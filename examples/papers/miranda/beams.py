"""The two beams of section 5.1.1: whole deflection curves against the theory of beams and the solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from miranda import solid
from running import Run
from sources import reference
from study import Claim, Cloud, Found, Line, Number, Panel, Row

Vector = NDArray[np.float64]

# Bonds of all pairs "within" the horizon, those as long as it included or not: rounding decides.
RADII = {"with the shell": 0.17320508075688773, "without the shell": 0.1732}
SURFACES = {"none": "no correction", "energy": "by energy", "directional": "by directions"}
CONTINUUM = 40e9 / 3.0
"""K in Pa of E = 20 GPa and nu = 1/4."""
LATTICE = 12.594065e9
"""K in Pa with which this lattice has the C11 of the continuum."""


@dataclass
class Bent:
    """A beam at rest under its load."""

    s: Vector
    """From the support, in m."""
    w: Vector
    """How far its axis goes down, in m."""
    side: Cloud
    points: int
    bonds: int

    def against(self, theory: Vector) -> float:
        """The largest difference, over the largest value of the theory."""
        return float(np.abs(self.w - theory).max() / theory.max())


def bend(run: Run, clamped: bool, surface: str, K: float = CONTINUUM, radius: float = RADII["with the shell"],
         potential: str = "silling2000", whole_end: bool = True) -> Bent:
    """The beam of the scene that has it, with other settings.

    With `whole_end` the last layer of the cantilever is loaded as the others, which makes 10 kN/m times 3.5 m; its
    scene, as the independent program, has half of that there.
    """
    scene = "../../clamped_beam/scene.toml" if clamped else "../../cantilever/scene.toml"
    changes: dict[str, Any] = {
        "horizon.surface": surface,
        "horizon.radius": radius,
        "material.parameters.K": K,
        "material.potential": potential,
    }
    if whole_end and not clamped:
        changes["load.1.force"] = [0.0, 0.0, "-500*t"]
    result = run.solve(scene, changes)
    at, down = result.frames[-1].positions, -result.displacement[:, 2]
    axis = np.isclose(at[:, 1], 0.15) & np.isclose(at[:, 2], 0.2)
    order = np.argsort(at[axis, 0])
    s, w = at[axis, 0][order] - 0.3, down[axis][order]
    free = (s > -1e-9) & (s < solid.SPAN + 1e-9)
    side = np.isclose(at[:, 1], 0.0)
    title = "vertical displacement of the side"
    picture = Cloud(title, at[side, 0].tolist(), at[side, 2].tolist(), (-down[side]).tolist(), "m", 9.0)
    return Bent(s[free], w[free], picture, result.summary["points"], result.summary["interactions"]["bonds"])


def finite_elements(run: Run, clamped: bool, section: solid.Section) -> tuple[Vector, Vector]:
    """Deflection along the axis of the solid beam."""

    def compute() -> list[list[float]]:
        size = (solid.SPAN, section.width, section.height)
        x, y, w = solid.deflections(size, (16, 2, 3), "xX" if clamped else "x", solid.LOAD / section.width)
        axis = np.isclose(y, section.width / 2.0)
        order = np.argsort(x[axis])
        return [x[axis][order].tolist(), w[axis][order].tolist()]

    s, w = run.once("finite elements", compute, clamped, section.width, section.height)
    return np.array(s), np.array(w)


def contour(run: Run, clamped: bool) -> Found:
    """Figs. 7 and 9: where the beam goes, and what an independent program says."""
    told = reference("beams")
    plain = bend(run, clamped, "none", whole_end=False)
    modified = bend(run, clamped, "none", potential="miranda_modified_stretch", whole_end=False)
    best = bend(run, clamped, "directional", whole_end=False)
    other, other_modified = told["static"][4:6] if clamped else told["static"][:2]
    curve = np.array(told["curves"]["clamped_none_s" if clamped else "cantilever_none_s"][1])
    name, printed = ("clamped beam", 5229) if clamped else ("cantilever", 4851)
    why = "the paper's text prints no deflection; its contours have colours alone"
    program = "another program (tests/reference/beams.json)"
    rows: list[Row] = [
        Number(f"points of the {name}", plain.points, printed),
        Number("largest deflection by s, no correction", float(plain.w.max()), unit="m",
               independent=other["w_max"], source=program, why=why),
        Number("largest deflection by the modified stretch, no correction", float(modified.w.max()), unit="m",
               independent=other_modified["w_max"], source=program, why=why),
        Number("largest deflection by s, corrected by directions", float(best.w.max()), unit="m", why=why),
        Claim("the modified stretch bends the beam as s does", "the two agree at small strain",
              f"deflections differ by {abs(modified.w.max() / plain.w.max() - 1.0):.1e}",
              bool(abs(modified.w.max() / plain.w.max() - 1.0) < 1e-3)),
    ]
    off = float(np.abs(plain.w - curve).max() / curve.max())
    notes = f"""The side of the beam, with surfaces corrected by directions and K = 13.33 GPa. The geometry is inferred
        from the number of points, the bonds of the caption are those of Fig. 3. The whole curve without a correction
        differs from that of an independent program by {off:.0e} of the largest deflection."""
    return Found(rows, [best.side], notes, columns=1)


@dataclass
class Reading:
    """What the paper leaves open of a beam, and how far from Euler and Bernoulli's deflection it ends."""

    words: str
    surface: str
    K: float
    radius: float
    section: solid.Section


def readings() -> list[Reading]:
    """All that were tried; more are in the notes of Fig. 10."""
    found = []
    for surface, words in SURFACES.items():
        for shell, radius in RADII.items():
            for section in (solid.POINTS, solid.VOLUMES):
                told = f"{words}, {shell}, {section.width:g} x {section.height:g} m"
                found.append(Reading(told, surface, CONTINUUM, radius, section))
    for section in (solid.POINTS, solid.VOLUMES):
        told = f"by directions with C11 of 24 GPa, {section.width:g} x {section.height:g} m"
        found.append(Reading(told, "directional", LATTICE, RADII["with the shell"], section))
    return found


def largest(run: Run, clamped: bool) -> dict[str, float]:
    """Of all readings the largest difference from Euler and Bernoulli, in percent of the largest deflection."""
    found = {}
    for one in readings():
        bent = bend(run, clamped, one.surface, one.K, one.radius)
        found[one.words] = 100.0 * bent.against(one.section.euler_bernoulli(clamped, bent.s))
    return found


def told(found: dict[str, float]) -> str:
    """As a sentence."""
    return "; ".join(f"{words}: {value:.1f} %" for words, value in found.items())


def half_of_the_shell(run: Run, clamped: bool) -> Bent:
    """Surfaces corrected by directions, in the middle of the two ways to count the bonds of length delta."""
    first, second = (bend(run, clamped, "directional", radius=radius) for radius in RADII.values())
    return Bent(first.s, 0.5 * (first.w + second.w), first.side, first.points, first.bonds)


def curves(run: Run, clamped: bool) -> Panel:
    """Figs. 8 and 10 as they are drawn, with what else was tried."""
    s = np.linspace(0.0, solid.SPAN, 71)
    up = -1e3
    lines = [Line("Euler and Bernoulli, 0.35 x 0.45 m", s.tolist(),
                  (up * solid.VOLUMES.euler_bernoulli(clamped, s)).tolist(), published=False, style="k-")]
    lines.append(Line("Timoshenko, 0.35 x 0.45 m", s.tolist(),
                      (up * solid.VOLUMES.timoshenko(clamped, s)).tolist(), style="k:"))
    lines.append(Line("Euler and Bernoulli, 0.3 x 0.4 m", s.tolist(),
                      (up * solid.POINTS.euler_bernoulli(clamped, s)).tolist(), style="--"))
    at, w = finite_elements(run, clamped, solid.VOLUMES)
    lines.append(Line("finite elements, 0.35 x 0.45 m", at.tolist(), (up * w).tolist(), style="x"))
    for surface, words in SURFACES.items():
        bent = bend(run, clamped, surface)
        lines.append(Line(words, bent.s.tolist(), (up * bent.w).tolist(), style="."))
    return Panel("deflection of the axis", "from the support, m", "mm", lines)


def ends(run: Run, clamped: bool) -> tuple[float, float, float]:
    """The largest deflection over Euler and Bernoulli's: by finite elements of both sections, and by Timoshenko."""
    s = np.array([solid.SPAN / 2.0 if clamped else solid.SPAN])
    over = []
    for section in (solid.POINTS, solid.VOLUMES):
        over.append(float(finite_elements(run, clamped, section)[1].max() / section.euler_bernoulli(clamped, s)[0]))
    theory = solid.VOLUMES.timoshenko(clamped, s)[0] / solid.VOLUMES.euler_bernoulli(clamped, s)[0]
    return over[0], over[1], float(theory)


def clamped_curves(run: Run) -> Found:
    """Fig. 8."""
    bent = half_of_the_shell(run, True)
    found = 100.0 * bent.against(solid.VOLUMES.euler_bernoulli(True, bent.s))
    every = told(largest(run, True)) if run.full else ""
    points, volumes, theory = ends(run, True)
    rows: list[Row] = [
        Claim("the beam bends as Euler and Bernoulli say", "within about 3 % everywhere",
              f"the solid itself is {100 * (points - 1):.1f} % (0.3 x 0.4 m) and {100 * (volumes - 1):.1f} % "
              f"(0.35 x 0.45 m) off, here {found:.1f} %", 2.5 <= found <= 3.5, refuted=min(points, volumes) > 1.05,
              source="finite elements in three dimensions, and Timoshenko",
              why=f"shear: Timoshenko's beam goes down {100 * (theory - 1):.1f} % more than Euler and Bernoulli's at "
                  "its middle, whatever E and load; the points leave no span longer than 4.1 m and no section lower "
                  "than 0.3 m, with which it is 6.4 %"),
    ]
    notes = f"""Largest differences over the largest deflection of Euler and Bernoulli, by what the paper leaves open:
        {every}. The row has the mean of the two by directions, as half of the bonds of length delta are counted
        (Fig. 3). About 3 % comes out where errors cancel: without a correction against the section between the
        outermost points, or with one by energy against that of the volumes; the same settings miss the cantilever
        of Fig. 10 by 14 to 18 %. Spans of 3.6, 3.8 and 4.1 m (six, four and one layers held) and the section
        lying on its side leave 3.3 to 15 % to the same settings, in no case together with the cantilever's 1 %."""
    return Found(rows, [curves(run, True)], notes, columns=1)


def cantilever_curves(run: Run) -> Found:
    """Fig. 10, and both beams at once."""
    bent = half_of_the_shell(run, False)
    found = 100.0 * bent.against(solid.VOLUMES.euler_bernoulli(False, bent.s))
    every = told(largest(run, False)) if run.full else ""
    points, volumes, _ = ends(run, False)
    both = [one / other for one, other in zip(ends(run, True), ends(run, False), strict=True)]
    ours = {}
    for surface, words in SURFACES.items():
        ratio = []
        for clamped in (True, False):
            w = bend(run, clamped, surface)
            ratio.append(w.w.max() / solid.VOLUMES.euler_bernoulli(clamped, w.s).max())
        ours[words] = float(ratio[0] / ratio[1])
    half = bend(run, False, "directional", whole_end=False)
    halved = 100.0 * half.against(solid.VOLUMES.euler_bernoulli(False, half.s))
    rows: list[Row] = [
        Number("largest difference from Euler and Bernoulli", found, 1.0, reading=0.5, unit="%",
               independent=100.0 * (volumes - 1.0), source="finite elements of the solid (scikit-fem)",
               correction="surfaces corrected by directions, as the paper's correction is not printed; half of the "
                          "bonds of length delta; the section of the volumes"),
        Claim("both beams at once",
              "3 % and 1 %: deflections over Euler and Bernoulli's differ between the beams by no more than 1.05",
              ", ".join(f"{value:.3f} {words}" for words, value in ours.items()),
              min(ours.values()) <= 1.05, refuted=min(both) > 1.05,
              source=f"finite elements {both[0]:.3f} and {both[1]:.3f}, Timoshenko {both[2]:.3f}",
              why="the ratio is free of E, of the load and of the section's inertia, and shear alone makes it 1.13 to "
                  "1.18: no correction of surfaces can bring both numbers"),
    ]
    notes = f"""Largest differences over the largest deflection of Euler and Bernoulli: {every}. The solid's is
        {100 * (points - 1):.1f} % (0.3 x 0.4 m) and {100 * (volumes - 1):.1f} % (0.35 x 0.45 m) by finite elements.
        With the load of half a layer at the end, 34.75 in place of 35 kN, the one by directions with the shell is
        {halved:.1f} % off."""
    return Found(rows, [curves(run, False)], notes, columns=1)


def relaxed(run: Run, spacings: int) -> tuple[float, float]:
    """The critical step in s of the beam's lattice at its scaled density, at spacings of 0.05 m times this over 4."""
    h = 0.05 * spacings / 4.0
    result = run.solve("relaxation.toml", {
        "body.box": [[0.0, 0.0, 0.0], [76 * h, 6 * h, 8 * h]],
        "body.spacing": h,
        "horizon.radius": 2.0 * np.sqrt(3.0) * h,
        "sets.clamped": f"X < {6.5 * h}",
        "sets.top": f"Z > {7.5 * h} and X > {6.5 * h} and X < {75.5 * h}",
        "sets.edge": f"Z > {7.5 * h} and X > {75.5 * h}",
        "probe.0.at": [76 * h, 3 * h, 4 * h],
        "motion.end": 1e-3,
        "motion.step": 1e-4,
    })
    told = reference("beams")["relaxation"][0]["dt_limit_eq31"]
    return float(result.summary["motion"]["critical_step_seconds"]), float(told) * spacings / 4.0


def steps_in_time(run: Run) -> list[Row]:
    """Of Fig. 9: the step of 1e-3 s, and where 15,000 of them lead."""
    critical, printed = relaxed(run, 4)
    rows: list[Row] = [
        Claim("the step of the beams follows from the paper's limit", "dt = 1e-3 s, by its eq. (31)",
              f"eq. (31) allows {printed:.3g} s; the true limit is {critical:.3g} s, so that 1e-3 s is stable",
              1e-3 <= printed, refuted=True, source="another program's eq. (31) (tests/reference/beams.json)",
              why="eq. (31) adds the stiffness of bonds as if all were aligned, and is below the true limit by half"),
    ]
    if run.full:
        result = run.solve("relaxation.toml")
        told = reference("beams")["relaxation"][0]
        why = "the paper's text prints no deflection"
        rows += [
            Number("deflection at 10 s of the relaxation", -float(result.probes["end_w"][10]), unit="m",
                   independent=told["tip_t10"], source="another program", why=why, cheap=False),
            Number("deflection at 15 s of the relaxation", -float(result.probes["end_w"][-1]), unit="m",
                   independent=told["final_tip"], source="another program", why=why, cheap=False),
        ]
    return rows
