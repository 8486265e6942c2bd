"""Table 3: how the residual of Newton's method falls during the extension of a cube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from running import Run
from sources import printed
from study import Claim, Found, Line, Number, Panel, Row, figure

PAPER = "javili2020"
INCREMENTS = (1, 5, 10, 15, 20, 25)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cube:
    """A cube of `intervals` spacings along an edge, and how its ends are held."""

    intervals: int
    spacings: float
    """Horizon."""
    outside: int
    """Layers beyond each end of the cube that are held and go on with the mean strain."""
    inside: int
    """Layers of the cube itself that are held, too."""
    middle_rests: bool
    """Whether both ends move apart, or the right one from the left."""

    def overrides(self, **coefficients: float) -> dict[str, Any]:
        half = 0.5 * self.intervals
        held = half - self.inside + 0.5
        u = "t*X" if self.middle_rests else f"t*(X + {half!r})"
        return {
            "body.box": [[-half - self.outside, -half, -half], [half + self.outside, half, half]],
            "horizon.spacings": self.spacings,
            "sets.left": f"X < {-held!r}",
            "sets.right": f"X > {held!r}",
            "prescribe.0.u": [u, 0, 0],
            "prescribe.1.u": [u, 0, 0],
            **{f"material.parameters.{name}": value for name, value in coefficients.items()},
        }


# In lengths of its spacing; the first increment of bonds alone is within 3 % of what is printed.
SMALL = Cube(10, 2.0, 1, 0, False)
# The setting of those that were tried that comes nearest to what is printed of bonds alone.
NEAREST = Cube(25, 2.5, 1, 1, True)


def published() -> dict[tuple[str, int, int], tuple[float, float]]:
    """Numbers of the table and half of their last digit, by kind, iteration and increment."""
    found = {}
    for one in printed(PAPER, "Table 3"):
        kind, iteration = one.line.split(" iteration ")
        found[kind, int(iteration), int(one.x)] = one.y, one.reading
    return found


@dataclass
class Falls:
    """Residuals over the first of their increment, by increment, and the contraction at the end."""

    ratios: dict[int, list[float]]
    contraction: float
    """Lateral displacement of the middle section in edges of the cube."""

    def worst(self) -> float:
        """The largest R[k+1]/R[k]^2 above the rounding."""
        found = [
            after / before**2
            for ratios in self.ratios.values()
            for before, after in zip([1.0, *ratios[:-1]], ratios, strict=True) if after > 1e-13
        ]
        return max(found)


def falls(run: Run, cube: Cube, **coefficients: float) -> Falls:
    """2-norms of the residual by the program's own iterations."""
    result = run.solve("newton.toml", cube.overrides(**coefficients))
    steps = result.summary["steps"]
    ratios = {}
    for increment in INCREMENTS:
        step = steps[increment - 1]
        assert len(steps) == 25, "an increment was halved"
        ratios[increment] = [one / step["residual"][0] for one in step["residual"][1:]]
    frame = result.frames[-1]
    middle = np.abs(frame.positions[:, 0]) < 0.6
    return Falls(ratios, float(np.abs(frame["displacement"][middle, 1]).max()) / cube.intervals)


def pointwise(run: Run, cube: Cube) -> dict[str, dict[int, list[float]]]:
    """Residuals of bonds alone as a sum over points, and with each point's own effective volume.

    With V1 = VH/#N1 of its own a point's equation is that of the energy times a number, so that iterates stay what
    they are, and the norm changes. Increments begin at the equilibria that the program found.
    """
    overrides = {**cube.overrides(), "output.frames": 25}
    result = run.solve("newton.toml", overrides)
    body = run.scene("newton.toml", overrides).body()
    found: dict[str, dict[int, list[float]]] = {"energy": {}, "own V1": {}}
    frames = result.frames
    for increment in INCREMENTS:
        start = np.asarray(frames[increment - 1]["displacement"])
        target = np.asarray(frames[increment]["displacement"])
        for name, ratios in run.once("newton", lambda: newton(body, cube, start, target), cube, increment).items():
            found[name][increment] = ratios
    return found


def newton(body: Any, cube: Cube, start: Array, target: Array) -> dict[str, list[float]]:
    """Three iterations from a displacement, with what is held moved to where the target has it."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import cg

    held = np.abs(body.positions[:, 0]) > 0.5 * cube.intervals - cube.inside + 0.5
    free = np.repeat(~held, 3)
    u = start.copy()
    u[held] = target[held]
    neighbours = np.zeros(len(u))
    norms: dict[str, list[float]] = {"energy": [], "own V1": []}
    for iteration in range(4):
        energy = body.energy(u)
        gradient = np.asarray(energy.gradient).reshape(-1, 3)
        K = energy.tangent().tocsr()
        if not neighbours.any():
            neighbours = np.diff(K.tobsr((3, 3)).indptr) - 1.0
        norms["energy"].append(float(np.linalg.norm(gradient[~held])))
        norms["own V1"].append(float(np.linalg.norm(gradient[~held] / neighbours[~held, None])))
        if iteration < 3:
            K = K[free][:, free]
            step, left = cg(K, -gradient.ravel()[free], rtol=1e-11, maxiter=4000, M=diags(1.0 / K.diagonal()))
            assert left == 0
            change = np.zeros(u.size)
            change[free] = step
            u = u + change.reshape(u.shape)
    return {name: [one / found[0] for one in found[1:]] for name, found in norms.items()}


KINDS = ("bonds", "bonds and areas", "bonds and volumes")
# Without dimension: C2 delta^4/C1 with which the first printed ratio of areas to bonds alone comes out, and
# C3 delta^8/C1 with which the last one of volumes does.
AREAS, VOLUMES = 0.09, 3e-4


def quadratic(kind: str, one: Falls) -> Claim:
    """Whether one moderate factor serves all increments. The largest in the printed table is 1.95."""
    steps = "; ".join(
        f"{increment}: " + ", ".join(f"{value:.2e}" for value in one.ratios[increment][:3]) for increment in (1, 25)
    )
    return Claim(
        f"{kind}: quadratic convergence at every increment", "residuals fall quadratically at all six increments",
        f"R[k+1] <= {one.worst():.2f} R[k]^2; increment {steps}", one.worst() < 2.0,
    )


def areas_over_bonds(run: Run, bonds: Falls, areas: Falls) -> list[Row]:
    """The second residual with areas over that without, which knows little of the cube and its clamps."""
    pub = published()
    rows: list[Row] = []
    for increment in INCREMENTS:
        with_areas, reading = pub["bonds and areas", 2, increment]
        without, other = pub["bonds", 2, increment]
        ratio = with_areas / without
        rows.append(Number(
            f"second residual with areas over that of bonds alone, increment {increment}",
            areas.ratios[increment][0] / bonds.ratios[increment][0], ratio,
            float(ratio * (reading / with_areas + other / without)),
            correction=f"C2 delta^4/C1 = {AREAS:g}, which the paper does not say",
            why="one coefficient does not meet all increments of another cube" if increment > 1 else "",
        ))
    return rows


def volumes_in_the_figure(run: Run, bonds: Falls, volumes: Falls) -> list[Row]:
    """Whether the coefficient of the table can be that of the figure, as section 4.4 says."""
    pub = published()
    printed = pub["bonds and volumes", 4, 25][0] / pub["bonds", 4, 25][0]
    ours = volumes.ratios[25][2] / bonds.ratios[25][2]
    # What is left of the residuals at equilibrium is what forces are rounded to.
    rounding = sum(one.ratios[25][-1] / one.ratios[25][2] for one in (bonds, volumes))
    gain = volumes.contraction / bonds.contraction - 1.0
    return [
        Number(
            "fourth residual with volumes over that of bonds alone, increment 25", ours, printed, 0.006 * printed,
            correction=f"C3 delta^8/C1 = {VOLUMES:g}, which the paper does not say", rounding=ours * rounding,
        ),
        Claim(
            "volumes of Table 3 are those of Fig. 14",
            "the table is of what the figure shows, where volumes make a cube visibly less compressible",
            "residuals that differ from those of bonds alone as little as the printed ones (by "
            f"{100 * (printed - 1):.0f} % in the fourth of increment 25) take "
            f"C3 delta^8/C1 = {VOLUMES:g}, which adds {100 * gain:.1f} % to the contraction",
            gain > 0.1,
            why="a coefficient that is seen in the figure changes the residuals severalfold: with 0.01 the fourth of "
            "increment 25 is 13 times that of bonds alone",
        ),
    ]


@figure(PAPER, "Table 3", "residuals of Newton's method during the extension of a cube")
def table03(run: Run) -> Found:
    bonds = falls(run, SMALL)
    areas = falls(run, SMALL, C2=AREAS / SMALL.spacings**4)
    volumes = falls(run, SMALL, C3=VOLUMES / SMALL.spacings**8)
    rows: list[Row] = [quadratic(kind, one) for kind, one in zip(KINDS, (bonds, areas, volumes), strict=True)]
    rows += areas_over_bonds(run, bonds, areas)
    rows += volumes_in_the_figure(run, bonds, volumes)
    shown = panels(run, (bonds, areas, volumes))
    if run.full:
        nearest = pointwise(run, NEAREST)
        rows += against_print(run, nearest["own V1"])
        shown.append(printed_panel(run, nearest))
    return Found(rows, list(shown), NOTES, columns=2)


def against_print(run: Run, ours: dict[int, list[float]]) -> list[Row]:
    """Bonds alone, number by number, of the cube that comes nearest."""
    pub = published()
    return [
        Number(
            f"bonds alone, increment {increment}, residual {iteration} over the first", ours[increment][iteration - 2],
            pub["bonds", iteration, increment][0], pub["bonds", iteration, increment][1],
            correction=CORRECTION, why=UNMET, cheap=False,
        )
        for increment in INCREMENTS for iteration in (2, 3, 4)
    ]


def printed_panel(run: Run, ours: dict[str, dict[int, list[float]]]) -> Panel:
    """Ours over the printed residuals of bonds alone."""
    pub = published()
    return Panel("bonds alone, nearest cube", "increment", "here over printed", [
        Line(
            f"residual {iteration}, {'own V1' if name == 'own V1' else 'one V1'}", list(INCREMENTS),
            [found[i][iteration - 2] / pub["bonds", iteration, i][0] for i in INCREMENTS],
            style="o-" if name == "own V1" else "x--",
        )
        for name, found in ours.items() for iteration in (2, 3, 4)
    ])


def panels(run: Run, small: tuple[Falls, ...]) -> list[Panel]:
    """Residuals by iteration, a panel per kind, with the printed ones of increments 1 and 25."""
    pub = published()
    made = []
    for kind, one in zip(KINDS, small, strict=True):
        lines = [
            Line(f"increment {i}", list(range(1, 5)), [1.0, *one.ratios[i][:3]], style="o-") for i in INCREMENTS
        ]
        for i in (1, 25):
            printed = [1.0, *(pub[kind, k, i][0] for k in (2, 3, 4))]
            lines.append(Line(f"printed, increment {i}", list(range(1, 5)), printed, published=True))
        made.append(Panel(kind, "iteration", "residual over the first", lines, log="y"))
    return made


CORRECTION = (
    "spacing 1/25 and horizon of 2.5 spacings; the first layer of the cube and one outside are held and stretched with "
    "the mean strain; norm with each point's own V1 = VH/#N1"
)
UNMET = (
    "the spacing, horizon and clamps that meet the first increment leave residuals that fall up to 17 % further at the "
    "last; no setting that was tried meets both"
)

NOTES = """The paper says 25 increments and the 2-norm, not the spacing, the horizon, the clamps or the coefficients.
The three kinds of interactions are compared on a small cube of ten spacings with a horizon of 2 of them, one layer
outside each end, its left end at rest: its first increment is within 3 % of the print, the second residual of its
last 42 % below. For bonds alone the settings were searched, not every combination of them: horizons that take in
neighbours up to sqrt(2), sqrt(3), 2, sqrt(5), sqrt(6), sqrt(8) and 3 spacings; 8 to 30 spacings along an edge; none
to three layers held outside the cube and none to three of its own; layers that move rigidly or go on with the mean
strain, that are held across the extension or free; both ends moved or one; norms of the plain residual, with volumes
halved on faces, and with each point's own V1. Coefficients and weights do not matter there: C1 is a common factor,
and other weights of points scale rows of the system, which changes norms and no iterate. What the clamps are shows in
the first residuals, what the horizon is in their fall. The second residual at increment 25 over that at increment 1
is 0.343 in print; with mean strain outside, a horizon of 2 spacings has 0.60 to 0.74 times that, sqrt(5) 0.85,
sqrt(6) 0.98, 3 spacings 0.96. R4/R3^2 over R3/R2^2 at increment 1 is 1.31 in print; with 3 spacings it is 1.12 to
1.14, with sqrt(6) 1.24 to 1.29. So a horizon of 2.5 spacings it is, or near; with 25 of them along an edge that is
0.1. The clamps that come out then are those of Table 6 of firooz2023. With areas and volumes that cube has 7.8
million triangles and 42 million tetrahedra: not done."""
