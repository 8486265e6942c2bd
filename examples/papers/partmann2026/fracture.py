"""Figs. 16, 18 and 19: plates that break."""

from __future__ import annotations

from typing import Any

import numpy as np

from running import Run
from study import Claim, Map, Found, Line, Number, Panel, Row, figure

from partmann2026.cracks import Plate, gradients
from partmann2026.published import ANOTHER, PAPER

NO_NUMBER = "the paper prints no number"
STEEL = {"bulk": 140e9, "shear": 84e9, "gc": 2700.0}
# Stiffness of (4.11) inside for C_s = 1, in Pa/m^2, on the paper's lattice, with w_0 as a plain sum (the number of
# neighbours) and C_s in 1/mm, or in 1/m. With w_0 as the integral that is printed the body would be stiffer than
# any bond by a factor of some thousands (C_s in mm^2) and more, and no step could follow it.
PER_MM = 9.71e17
PER_M = 9.71e14


def mode(run: Run, across: int, settings: dict[str, Any], end: str = "60 us") -> Plate:
    """The plate of section 5.2 with so many points along its edge."""
    spacing = 1e-3 / across
    result = run.solve("../../mode_I/scene.toml", {
        "body.spacing": spacing,
        "sets.lower": f"Y < {spacing!r}",
        "sets.upper": f"Y > {1e-3 - spacing!r}",
        "output.every": "20 us",
        "motion.end": end,
        **settings,
    }, threads=None if across > 30 else 1, may_fail=True)
    return Plate(result, spacing, 1e-3, 1e-3)


def silling(across: int, cs: float) -> dict[str, Any]:
    """CS with a stiffness on the paper's lattice; it goes with 1/dx^2 as that of the body does."""
    return gradients(**STEEL, kernel="constant", discretisation="stabilised", stabilisation="silling",
                     stiffness=cs * (across / 100.0) ** 2)


OSB = {
    "material.potential": "linear_peridynamic_solid_brittle",
    "material.parameters": {"K": 140e9, "G": 84e9, "Gc": 2700.0, "p": 0},
}
WAN = gradients(**STEEL, kernel="constant", discretisation="stabilised", stabilisation="wan")
BAQP = gradients(**STEEL, kernel="constant", discretisation="bond-quadrature")


@figure(PAPER, "Fig. 16", "a crack that opens straight (mode I)")
def fig16(run: Run) -> Found:
    bonds, states = mode(run, 20, {}), mode(run, 20, OSB)
    rows: list[Row] = [
        straight("A, BB, 20 x 20 x 2 points", "the expected straight crack", bonds),
        straight("B, OSB, 20 x 20 x 2 points", "the expected straight crack", states),
        torn("A, BB, 20 x 20 x 2 points", bonds), torn("B, OSB, 20 x 20 x 2 points", states),
    ]
    panels = [bonds.map("A: BB, 20 x 20 x 2"), states.map("B: OSB, 20 x 20 x 2")]
    if run.full:
        more, panels = others(run)
        rows += more
    notes = """Which points carry the velocity, how long the run is, kernels, the unit of C_s and the regularisation of
    shape tensors are not printed. Here the outermost layers move and do not fail, for 60 us; nothing is regularised,
    and points whose family determines no gradient any more are released. The paper's 100 x 100 x 10 points take
    sixteen times as long as the 50 x 50 x 5 of BB here, and models with gradients ten times as long as bonds, so that
    these are on 30 x 30 x 3. That C_s has a unit is not said in the paper: both rows of CS below are readings of it."""
    return Found(rows, list(panels), notes, columns=3 if run.full else 2)


def straight(what: str, published: str, plate: Plate, why: str = "", cheap: bool = True) -> Claim:
    """Whether one straight crack goes through."""
    return Claim(what, published, told(plate), plate.runs_straight(), why=why, cheap=cheap)


def torn(what: str, plate: Plate, cheap: bool = True) -> Claim:
    """Single points that are damaged much more than the crack."""
    count, far = plate.torn()
    return Claim(
        f"points of large damage, {what}", "single ones around the edges of the crack",
        f"{count} points have lost seven tenths of their family, all within {far:.1f} spacings of an edge of the plate",
        0 < count < 0.02 * plate.points, cheap=cheap, why="one point at least, and a fiftieth of all at most",
    )


def told(plate: Plate) -> str:
    """How a plate broke, in words."""
    start, through = 1e6 * plate.passed(0.5 * plate.length), 1e6 * plate.passed(plate.length - 2 * plate.spacing)
    times = f"starts at {start:.1f} us, through at {through:.1f} us" if plate.through else \
        f"comes to {1e3 * plate.tip:.2f} mm of {1e3 * plate.length:g}"
    return f"{plate.ended}; the crack {times}; {100 * plate.straight():.0f} % of new damage in its plane"


def others(run: Run) -> tuple[list[Row], list[Map]]:
    """The other panels, and bonds on a finer lattice."""
    fine, corrected = mode(run, 50, {}), mode(run, 30, {"horizon.surface": "energy"})
    states = mode(run, 30, OSB)
    few, many = mode(run, 30, silling(30, 10 * PER_MM)), mode(run, 30, silling(30, 100 * PER_MM))
    less, more = mode(run, 20, silling(20, 10 * PER_M)), mode(run, 20, silling(20, 100 * PER_M))
    wan, quadrature = mode(run, 30, WAN, "120 us"), mode(run, 30, BAQP)
    rows: list[Row] = [
        straight("A, BB, 50 x 50 x 5 points", "the expected straight crack", fine, cheap=False),
        straight("A, BB with surface correction, 30 x 30 x 3 points", "the expected straight crack", corrected,
                 cheap=False),
        straight("B, OSB, 30 x 30 x 3 points", "the expected straight crack", states, cheap=False),
        torn("A, BB with surface correction, 30 x 30 x 3 points", corrected, cheap=False),
        *times(fine),
        pair("C, D, CS, C_s = 10 and 100 per mm, 30 x 30 x 3 points", few, many),
        pair("C, D, CS, C_s = 10 and 100 per m, 20 x 20 x 2 points", less, more),
        Claim(
            "C, CS, C_s = 10, end of the run", "ends early, for it is unstable",
            f"{few.ended} (per mm, with {100 * few.spread():.0f} % of all points damaged), {less.ended} (per m)",
            not (few.completed and less.completed), cheap=False,
            why="nothing ends a run here before a point flies off; when the paper's ended, and by what, is not said",
        ),
        straight("E, CW, 30 x 30 x 3 points, 120 us", "a cleaner crack, more stable", wan, cheap=False,
                 why="it breaks later than all others: coarse lattices are too stiff with this stabilisation"),
        straight("F, BAQP, 30 x 30 x 3 points", "a well-defined crack without artefacts", quadrature, cheap=False),
    ]
    shown = [fine.map("A: BB, 50 x 50 x 5"), states.map("B: OSB, 30 x 30 x 3")]
    shown += [few.map("C: CS, C_s = 10 per mm"), many.map("D: CS, C_s = 100 per mm")]
    shown += [wan.map("E: CW, 120 us"), quadrature.map("F: BAQP, constant kernel")]
    return rows, shown


def pair(what: str, weak: Plate, stiff: Plate) -> Claim:
    """The two numbers of CS."""
    return Claim(
        what, "with 10 the crack is not captured, with 100 it is",
        f"10: {told(weak)}. 100: {told(stiff)}", not weak.runs_straight() and stiff.completed and stiff.through,
        cheap=False,
    )


def times(plate: Plate) -> list[Row]:
    """When the crack of 50 x 50 x 5 points is where, beside another program."""
    found = (
        ("first bond breaks", plate.first, 40.1e-6), ("the tip moves", plate.passed(0.5e-3), 53.2e-6),
        ("half of the way", plate.passed(0.75e-3), 54.0e-6), ("through", plate.passed(0.97e-3), 55.4e-6),
    )
    return [
        Number(f"A, 50 x 50 x 5 points, {what}", ours, None, unit="s", independent=theirs, source=ANOTHER,
               why=NO_NUMBER, cheap=False)
        for what, ours, theirs in found
    ]


def tension(
    run: Run, across: tuple[int, int, int], settings: dict[str, Any], gc: float, end: str, stress: float = 1e6,
) -> Plate:
    """The plate of section 5.3 with so many points along its edges, under a stress in Pa."""
    spacing = 0.1 / across[0]
    pull = stress / spacing
    given = dict(settings)
    given.setdefault("material.parameters", {"K": 32e9 / 1.8, "Gc": gc})
    result = run.solve("../../boundary_tension/scene.toml", {
        "body.box": [[0, 0, 0], [0.1, across[1] * spacing, across[2] * spacing]],
        "body.spacing": spacing,
        "sets.lower": f"Y < {spacing!r}",
        "sets.upper": f"Y > {across[1] * spacing - spacing!r}",
        "load.0.density": [0, -pull, 0],
        "load.1.density": [0, pull, 0],
        # 0.7 of (3.58) inside, which goes with the spacing.
        "motion.step": 9.23381362273217e-8 * spacing / 5e-4,
        "motion.end": end,
        "output.every": "10 us",
        **given,
    }, may_fail=True)
    return Plate(result, spacing, 0.1, across[1] * spacing)


GLASS = {"bulk": 32e9 / 1.8, "shear": 32e9 / 2.4}
# Stiffness on the paper's lattice for C_s = 100 per mm with w_0 as a plain sum, as above, in Pa/m^2: twice that of CW.
GLASS_CS = 2.47e17


@figure(PAPER, "Fig. 18", "a crack that forks (boundary tension test)")
def fig18(run: Run) -> Found:
    coarse = tension(run, (100, 40, 4), {}, 3.0, "75 us")
    rows: list[Row] = [
        Number(f"BB, 100 x 40 x 4 points, 3 J/m^2: {what}", ours, None, unit=unit, independent=theirs, source=ANOTHER,
               why="a coarse run, of which the paper says nothing")
        for what, ours, theirs, unit in (
            ("mean speed of the tip", coarse.speed, 954.53, "m/s"),
            ("exit", coarse.passed(0.0985), 70.21e-6, "s"),
            ("broken bonds", float(coarse.broken), 17038.0, ""),
        )
    ]
    panels = [coarse.map("BB, 100 x 40 x 4, 3 J/m^2")]
    if run.full:
        more, panels = plates(run)
        rows += more
    notes = """How the stress becomes a force, when it begins, how long the run is, kernels and the regularisation of
    shape tensors are not printed. Here the outermost layers carry 1 MPa over their thickness, at once, and do not fail.
    Bonds are on the paper's lattice. Models with gradients take ten times as long and are on half as fine a lattice
    with 3 J/m^2, which another program has, too; there no crack forks, that of bonds neither, so that these rows are
    about where damage goes and not about forks. On the paper's lattice, where a run takes an hour, CW was found to run
    straight through until 55 us, as in Fig. 18 C, and BAQP with the constant kernel straight to 98 mm at 48 us, without
    the forks of Fig. 18 D; another program found a late fork of it at 94 mm. 0.75 J/m^2 is a quarter of what this test
    has elsewhere."""
    return Found(rows, list(panels), notes, columns=2)


def plates(run: Run) -> tuple[list[Row], list[Map]]:
    """Bonds as in the paper, the other models on a coarser lattice."""
    bonds = tension(run, (200, 80, 8), {}, 0.75, "65 us")
    corrected = tension(run, (200, 80, 8), {"horizon.surface": "energy"}, 0.75, "65 us")
    half = (100, 40, 4)
    stiff, soft = (tension(run, half, gradients(
        **GLASS, gc=3.0, kernel="constant", discretisation="stabilised", stabilisation="silling", stiffness=one / 4.0,
    ), 3.0, "75 us") for one in (GLASS_CS, GLASS_CS / 1000.0))
    cw = tension(run, half, gradients(**GLASS, gc=3.0, kernel="constant", discretisation="stabilised",
                                      stabilisation="wan"), 3.0, "75 us")
    quadrature = gradients(**GLASS, gc=3.0, kernel="constant", discretisation="bond-quadrature")
    baqp = tension(run, half, quadrature, 3.0, "75 us")
    rows: list[Row] = [
        forks("A, BB", bonds), forks("A, BB with surface correction", corrected), *numbers(bonds),
        *(unstable(f"B, CS, 100 x 40 x 4 points, C_s = 100 per {unit}", one, cw) for unit, one in
          (("mm", stiff), ("m", soft))),
        Claim(
            "C, CW, 100 x 40 x 4 points", "one crack that does not fork", told(cw),
            bool(np.isnan(cw.fork())) and cw.tip > 0.09, cheap=False,
        ),
        Claim(
            "D, BAQP, constant kernel, 100 x 40 x 4 points", "forks, more broadly than BB and into more arms",
            f"{told(baqp)}; " + (f"fork at {1e3 * baqp.fork():.1f} mm" if baqp.fork() > 0 else "no fork"),
            not np.isnan(baqp.fork()), cheap=False,
            why="on this lattice bonds do not fork either; see below for the paper's",
        ),
    ]
    panels = [bonds.map("A: BB, 200 x 80 x 8, 0.75 J/m^2"), soft.map("B: CS, 100 per m, 100 x 40 x 4, 3 J/m^2")]
    panels += [cw.map("C: CW, 100 x 40 x 4, 3 J/m^2"), baqp.map("D: BAQP, 100 x 40 x 4, 3 J/m^2")]
    return rows, panels


def unstable(what: str, cs: Plate, cw: Plate) -> Claim:
    """What the paper says of CS."""
    return Claim(
        what, "unrealistic damage, an early end",
        f"{told(cs)}; {100 * cs.spread():.1f} % of all points are damaged, {100 * cw.spread():.1f} % with CW",
        cs.spread() > 2.0 * cw.spread() or not cs.completed, cheap=False,
        why="twice the damage of CW or an early end is taken as that; C_s is not printed for this plate, and another "
        "program has 22 % with a choice of its own",
    )


def forks(what: str, plate: Plate) -> Claim:
    """That the crack has two arms."""
    return Claim(
        f"{what}, 200 x 80 x 8 points", "the expected fork", f"forks at {1e3 * plate.fork():.1f} mm; {told(plate)}",
        not np.isnan(plate.fork()), cheap=False,
    )


def numbers(plate: Plate) -> list[Row]:
    """Bonds on the paper's lattice beside another program."""
    found = (
        ("fork", plate.fork(), 0.06525, "m"), ("mean speed of the tip", plate.speed, 1039.0, "m/s"),
        ("exit", plate.passed(0.0992), 56.33e-6, "s"), ("broken bonds", float(plate.broken), 187086.0, ""),
    )
    return [
        Number(f"A, BB, 200 x 80 x 8 points: {what}", ours, None, unit=unit, independent=theirs, source=ANOTHER,
               why=NO_NUMBER, cheap=False)
        for what, ours, theirs, unit in found
    ]


@figure(PAPER, "Fig. 19", "loss of stability of BAQP with the cubic kernel")
def fig19(run: Run) -> Found:
    kernels = {"constant": constant, "cubic spline": spline}
    worse = {name: degraded(kernel) for name, kernel in kernels.items()}
    rows: list[Row] = [
        Claim(
            "shape tensor where the nearest of 122 neighbours go", "degrades faster with the cubic kernel",
            "; ".join(f"{name}: 1/K grows {one[0]:.2f} times without the nearest six, {one[1]:.2f} times without 26"
                      for name, one in worse.items()),
            all(a > b for a, b in zip(worse["cubic spline"], worse["constant"])),
            why="where all bonds through a plane go, K across it is half of what it was with any kernel",
        ),
    ]
    panels: list[Panel | Map] = []
    if run.full:
        cubic = gradients(**GLASS, gc=0.75, kernel="cubic-spline", discretisation="bond-quadrature")
        plate = tension(run, (150, 60, 6), cubic, 0.75, "45 us")
        more = tension(run, (150, 60, 6), cubic, 0.75, "45 us", 4e6 / 3.0)
        rows += [*lost("1 MPa", plate), *lost("1.33 MPa", more)]
        both = (("1 MPa", plate), ("1.33 MPa", more))
        panels = [one.map(f"BAQP, cubic kernel, {load}, {one.ended}") for load, one in both]
        panels += [energies(f"energies at {load}", one) for load, one in both]
    notes = """On 150 x 60 x 6 points in place of 200 x 80 x 8, with the thickness of the paper. Nothing is regularised,
    for the paper does not print how. Under 1 MPa the crack runs straight and stable; under 1.33 MPa it goes as the
    paper has it. Where the deletion of bonds creates energy, the column `released` falls: that
    comes first, and what grows without bound later."""
    return Found(rows, list(panels), notes)


def energies(title: str, plate: Plate) -> Panel:
    """Against time."""
    table = plate.result.table("motion")
    return Panel(title, "t, us", "J", [
        Line(name, (1e6 * table["t"]).tolist(), table[name].tolist(), style="-")
        for name in ("kinetic", "stored", "released")
    ], log="y")


def lost(load: str, plate: Plate) -> list[Row]:
    """Whether it becomes unstable, when and where."""
    table, tips = plate.result.table("motion"), plate.result.table("fracture")
    falls = np.flatnonzero(np.diff(table["released"]) < -1e-7)
    begins, near = "deletion of bonds never creates energy", False
    why = "" if not plate.completed else (
        "the run is stable until the crack is through, as that of another program on 200 x 80 x 4 points; a load that "
        "is a third larger makes it unstable, so that it hangs on settings that are not printed"
    )
    if len(falls):
        when = float(table["t"][falls[0] + 1])
        tip = float(np.interp(when, tips["t"], tips["tip_tip"]))
        near = 0.060 < tip < 0.085
        begins = f"deletion of bonds creates energy from {1e6 * when:.1f} us on, with the tip at {1e3 * tip:.0f} mm"
    return [
        Claim(
            f"BAQP, cubic kernel, 150 x 60 x 6 points, {load}", "loses stability, and grows without bound",
            f"{plate.ended}; {begins}", not plate.completed, cheap=False, why=why,
        ),
        Claim(
            f"where it begins, {load}", "shortly after the point at which cracks fork",
            f"{begins}; bonds fork at 65 mm", near, cheap=False,
            why=why or "within 20 mm behind the fork of bonds is taken as shortly",
        ),
    ]


def constant(r: float) -> float:
    return 1.0


def spline(r: float) -> float:
    """(4.35) without its factor, of the distance over the horizon."""
    return 1.0 - 6.0 * r * r + 6.0 * r**3 if r <= 0.5 else 2.0 * (1.0 - r) ** 3


def degraded(kernel: Any) -> tuple[float, float]:
    """How much the largest eigenvalue of 1/K grows where the nearest 6 and 26 neighbours are gone."""
    family = [np.array(x) - 3.0 for x in np.ndindex(7, 7, 7)]
    family = [x for x in family if 0.0 < x @ x <= 3.015**2]

    def largest(kept: list[Any]) -> float:
        shape = sum(kernel(float(np.sqrt(x @ x)) / 3.015) * np.outer(x, x) for x in kept)
        return 1.0 / float(np.linalg.eigvalsh(shape)[0])

    six, more = ([x for x in family if x @ x > within] for within in (1.5, 3.5))
    return largest(six) / largest(family), largest(more) / largest(family)
