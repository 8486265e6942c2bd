"""Figs. 5 and 6: finer spacings in one horizon, and smaller horizons of as many spacings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firooz2023.pointwise import Settings
from firooz2023.pointwise import extension as pointwise
from javili2020.local import square
from running import Run
from study import AGREES, Claim, Cloud, Found, Line, Number, Panel, Row, figure

PAPER = "javili2020"
STRAIN = 1e-3
# Points on the edges of the hole stay.
HOLE = "max(abs(X - 0.5), abs(Y - 0.5)) < 0.2 - 1e-5"
# AA' is at the top of the hole, BB' on the upper edge.
AA, BB = "AA'", "BB'"
HEIGHTS = {AA: 0.7, BB: 1.0}
BODIES = {"full": False, "with hole": True}

Array = NDArray[np.float64]


@dataclass
class Field:
    """Displacements in m at points of a square, clamps left out."""

    X: Array
    u: Array

    def along(self, line: str) -> tuple[Array, Array]:
        """Abscissas and displacements along AA' or BB'."""
        here = np.flatnonzero(np.abs(self.X[:, 1] - HEIGHTS[line]) < 1e-9)
        here = here[np.argsort(self.X[here, 0])]
        return self.X[here, 0], self.u[here]


def extended(run: Run, cells: int, m: float, hole: bool, layers: str = "outside") -> Field:
    """The square of `cells` spacings along an edge with a horizon of m of them, under 0.1 %."""
    spacing = 1.0 / cells
    thick = spacing * np.floor(m + 1e-9)
    out, within = (float(thick), 0.0) if layers == "outside" else (0.0, float(thick - spacing))
    result = run.solve("strip.toml", {
        "body.box": [[-out, 0.0], [1.0 + out, 1.0]],
        "body.spacing": spacing,
        "body.remove": [HOLE] if hole else [],
        "horizon.spacings": m,
        "sets.left": f"X < {within + 1e-6!r}",
        "sets.right": f"X > {1.0 - within - 1e-6!r}",
    })
    frame = result.frames[-1]
    X = frame.positions[:, :2]
    body = (X[:, 0] > -1e-9) & (X[:, 0] < 1.0 + 1e-9)
    return Field(X[body], frame["displacement"][body, :2])


def beside(run: Run, cells: int, m: float) -> Field:
    """The full square with layers outside by the program beside piola, which keeps a quadrant."""

    def compute() -> list[list[list[float]]]:
        layers = int(np.floor(m + 1e-9))
        settings = Settings(2, cells, m, inside=1, outside=layers, halved=True, increment=STRAIN)
        _, body, x = pointwise(settings, STRAIN, (STRAIN,))
        right = np.abs(body.place[:, 0]) <= cells // 2
        X, u = body.X[right], (x - body.X)[right]
        left = X[:, 0] > 0.0
        mirror = np.array([-1.0, 1.0])
        # The left end of the square rests at X = 0.
        X, u = np.vstack([X, X[left] * mirror]) + 0.5, np.vstack([u, u[left] * mirror])
        u[:, 0] += 0.5 * STRAIN
        return [X.tolist(), u.tolist()]

    X, u = run.once("pointwise", compute, cells, m)
    return Field(np.array(X), np.array(u))


def local(run: Run, hole: bool, cells: int = 160) -> Field:
    """The same by finite elements."""

    def compute() -> dict[str, list[list[float]]]:
        return {name: array.tolist() for name, array in square(cells, hole, STRAIN).items()}

    found = run.once("local", compute, hole, cells)
    return Field(np.array(found["X"]), np.array(found["u"]))


def deviation(one: Field, other: Field, line: str, axis: int) -> float:
    """Largest difference along a line, over the largest value of the other there."""
    x, u = one.along(line)
    X, U = other.along(line)
    inside = (x >= X[0] - 1e-9) & (x <= X[-1] + 1e-9)
    found = np.abs(u[inside, axis] - np.interp(x[inside], X, U[:, axis])).max()
    return float(found / np.abs(U[:, axis]).max())


def shapes(fields: dict[str, Field], which: str) -> list[Claim]:
    """What section 4.1 says about the vertical displacement along both lines."""
    lines = {(body, line): fields[body].along(line) for body in BODIES for line in HEIGHTS}
    v = {key: u[:, 1] for key, (_, u) in lines.items()}
    size = max(float(np.abs(one).max()) for one in v.values())
    odd = max(float(np.abs(one - one[::-1]).max()) for one in v.values()) / size
    middle = {key: float(one[len(one) // 2]) for key, one in v.items()}
    monotone = all(
        bool(np.all(np.diff(v["full", line][: len(v["full", line]) // 2 + 1]) < 1e-12)) for line in HEIGHTS
    )
    upper = v["with hole", "BB'"]
    falls = bool(np.all(np.diff(upper[: len(upper) // 2 + 1]) < 1e-12))
    inner = v["with hole", "AA'"]
    rise = float(inner[: len(inner) // 2 + 1].max())
    least = int(np.argmin(inner))
    told = {key: f"{1e3 * value:.4f}e-3" for key, value in middle.items()}
    return [
        Claim(
            f"full square, {which}: from the ends to the middle",
            "falls from 0 to an extremum in the middle on both lines",
            f"{told['full', AA]} m on AA' and {told['full', BB]} m on BB' in the middle",
            monotone and max(abs(float(v["full", line][0])) for line in HEIGHTS) < 1e-9,
        ),
        Claim(
            f"{which}: symmetry", "vertical displacements are symmetric about the middle",
            f"the two halves of the lines differ by {odd:.1e} of the largest displacement", odd < 1e-6,
        ),
        Claim(
            f"full square, {which}: which line moves more", "BB' contracts more than AA'",
            f"{middle['full', BB] / middle['full', AA]:.4f} times as much in the middle",
            middle["full", "BB'"] < middle["full", "AA'"] < 0.0,
        ),
        Claim(
            f"with hole, {which}: BB'", "falls from the edge to the middle",
            f"from {upper[0]:.1e} m to {told['with hole', BB]} m", falls,
        ),
        Claim(
            f"with hole, {which}: AA'", "rises at first and falls to an extremum in the middle then",
            f"up to {rise:.3e} m, and {told['with hole', AA]} m in the middle",
            rise > 1e-3 * size and abs(least - len(inner) // 2) <= 1,
        ),
        Claim(
            f"{which}: hole against full", "vertical displacements are larger with the hole on both lines",
            "; ".join(
                f"{line}: {np.abs(v['with hole', line]).max() / np.abs(v['full', line]).max():.3f} times"
                for line in HEIGHTS
            ),
            all(bool(np.abs(v["with hole", line]).max() > np.abs(v["full", line]).max()) for line in HEIGHTS),
        ),
    ]


def panels(names: list[str], fields: dict[str, dict[str, Field]], shown: str) -> list[Panel | Cloud]:
    """A row per body and component: along AA', over the square, along BB'."""
    made: list[Panel | Cloud] = []
    for body in BODIES:
        for axis, component in enumerate(("horizontal", "vertical")):
            sides = []
            for line in HEIGHTS:
                lines = []
                for name in names:
                    x, u = fields[name][body].along(line)
                    lines.append(Line(name, list(x), list(1e3 * u[:, axis]), style="k-" if name == "local" else "--"))
                sides.append(Panel(f"{body}, {component}, {line}", "X, m", "displacement, mm", lines))
            field = fields[shown][body]
            made += [
                sides[0],
                Cloud(
                    f"{body}, {component}, {shown}", list(field.X[:, 0]), list(field.X[:, 1]),
                    list(1e3 * field.u[:, axis]), "mm", size=2.7 if len(field.X) > 5000 else 8.0,
                ),
                sides[1],
            ]
    return made


def series(
    named: list[str], fields: dict[str, dict[str, Field]], last: str, published: str, others: list[Field] | None = None,
) -> list[Row]:
    """Deviations from the last, which are to fall from each curve to the next; a row per body and component.

    `others` are the full squares of the program beside piola.
    """
    rows: list[Row] = []
    for body in BODIES:
        for axis, component in enumerate(("horizontal", "vertical")):
            found = {
                line: [deviation(fields[name][body], fields[last][body], line, axis) for name in named]
                for line in HEIGHTS
            }
            told = "; ".join(f"{line} " + ", ".join(f"{100 * one:.2f} %" for one in found[line]) for line in HEIGHTS)
            falls = all(bool(np.all(np.diff(found[line]) < 0.0)) for line in HEIGHTS)
            same = bool(others) and body == "full" and all(
                np.allclose(found[line], [deviation(one, fields[last][body], line, axis) for one in others or []], rtol=AGREES)
                for line in HEIGHTS
            )
            rows.append(Claim(
                f"{body}, {component}: deviation from {last}", published, f"by {', '.join(named)}: {told}", falls,
                why="" if falls else where(named, fields, last, body, axis), cheap=False,
                refuted=same and not falls, source="all eight numbers by a program beside piola" if same else "",
            ))
    return rows


def where(named: list[str], fields: dict[str, dict[str, Field]], last: str, body: str, axis: int) -> str:
    """Where along each line the largest deviation lies, and how much the lines deviate in the mean."""
    told = []
    for line in HEIGHTS:
        places, means = [], []
        X, U = fields[last][body].along(line)
        for name in named:
            x, u = fields[name][body].along(line)
            apart = np.abs(u[:, axis] - np.interp(x, X, U[:, axis]))
            end = min(x[apart.argmax()], 1.0 - x[apart.argmax()])
            places.append(f"{end:.3f}")
            means.append(f"{100 * float(apart.mean() / np.abs(U[:, axis]).max()):.2f} %")
        told.append(f"{line}: largest at {', '.join(places)} m from an end, in the mean {', '.join(means)}")
    return "; ".join(told)


@figure(PAPER, "Fig. 5", "finer spacings in a horizon of 0.05 under 0.1 % extension")
def fig05(run: Run) -> Found:
    all_cells = (40, 80, 100, 160) if run.full else (80,)
    names = [f"spacing {1.0 / cells:g}" for cells in all_cells]
    fields = {
        name: {body: extended(run, cells, cells / 20.0, hole) for body, hole in BODIES.items()}
        for name, cells in zip(names, all_cells, strict=True)
    }
    rows: list[Row] = [*shapes(fields["spacing 0.0125"], "spacing 0.0125")]
    if run.full:
        fields["local"] = {body: local(run, hole, 80) for body, hole in BODIES.items()}
        rows += series(names[:-1], fields, names[-1], "falls with the spacing")
        inner = fields["local"]["with hole"].along("AA'")[1][:, 1]
        rise, middle = float(inner.max()), float(inner[len(inner) // 2])
        rows.append(Claim(
            "local elasticity with hole: AA'", "rises at first and falls to the middle then, too",
            f"up to {rise:.3e} m, and {middle:.3e} m in the middle", rise > 0.0 > middle, cheap=False,
        ))
        inside = {body: extended(run, 80, 4.0, hole, "inside") for body, hole in BODIES.items()}
        rows += [replace(row, cheap=False) for row in shapes(inside, "clamps inside")]
    return Found(rows, list(panels(names, fields, "spacing 0.0125")), NOTES5, columns=3)


@figure(PAPER, "Fig. 6", "smaller horizons of 8.5 spacings under 0.1 % extension")
def fig06(run: Run) -> Found:
    all_cells = (40, 50, 110, 210) if run.full else (40, 50)
    names = [f"horizon {8.5 / cells:.4g}" for cells in all_cells]
    fields = {
        name: {body: extended(run, cells, 8.5, hole) for body, hole in BODIES.items()}
        for name, cells in zip(names, all_cells, strict=True)
    }
    rows: list[Row] = []
    for name in names[:2]:
        for body in BODIES:
            u = fields[name][body].along("BB'")[1]
            rows.append(Number(
                f"vertical displacement in the middle of BB', {body}, {name}", 1e3 * float(u[len(u) // 2, 1]), None,
                unit="mm", why="the paper draws it and prints no number",
            ))
    if run.full:
        fields["local"] = {body: local(run, hole) for body, hole in BODIES.items()}
        others = [beside(run, cells, 8.5) for cells in all_cells]
        rows += series(names, fields, "local", "falls with the horizon", others)
        rows.append(coarser(run, fields["local"]))
        names = [*names, "local"]
    return Found(rows, list(panels(names, fields, "horizon 0.17")), NOTES6, columns=3)


def coarser(run: Run, fine: dict[str, Field]) -> Claim:
    """How much the finite elements themselves leave open."""
    rough = {body: local(run, hole, 80) for body, hole in BODIES.items()}
    parts = [deviation(rough[body], fine[body], line, axis) for body in BODIES for line in HEIGHTS for axis in (0, 1)]
    return Claim(
        "the mesh of the local solution", "fine enough",
        f"80 and 160 biquadratic elements along an edge differ by at most {100 * max(parts):.2f} % along the lines",
        max(parts) < 0.01, cheap=False,
    )


COMMON = """The paper leaves open where the clamps are, whether points lie on the edges, and whether the hole has 40 %
of the edge or of the area. Here points lie on the edges, those on the sides with half a cell; the hole has an edge of
0.4, as in section 4.4; the clamps are layers outside the square as thick as the horizon, which go on with the mean
strain."""

NOTES5 = COMMON + """ At a spacing of 0.025 the horizon holds twelve neighbours, whose Poisson's ratio is 0.19 and not
1/3 (lattice_constants.json): that curve is far from the others. The rows of clamps inside have the layers within
the square instead."""

NOTES6 = COMMON + """ Only 0.17 of the four horizons makes a whole number of spacings along the edge at 8.5 of them, so
the spacings are 1/40, 1/50, 1/110 and 1/210, which put points on the edges of the hole, and the horizons 0.2125, 0.17,
0.0773 and 0.0405 in place of 0.21, 0.17, 0.08 and 0.04. The local solution has lambda = mu, the plane counterpart of
bonds alone, by finite elements (scikit-fem)."""
