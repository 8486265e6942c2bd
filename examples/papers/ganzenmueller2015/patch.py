"""The patch of section 5.2.1: its cloud (Fig. 2) and its motion (Fig. 3)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ganzenmueller2015 import quads, sketches
from ganzenmueller2015.algorithm import move
from ganzenmueller2015.families import (
    PAPER,
    Array,
    Families,
    Whole,
    cloud,
    families,
    own_radii,
    published,
)
from ganzenmueller2015.sph import cubic_spline, peridynamic_forces
from ganzenmueller2015.trajectory import STEP, Trajectory, follow
from running import Run
from sources import reference
from study import AGREES, Claim, Found, Line, Number, Panel, Picture, Row, figure

RADIUS = 0.105
COUNT = 8
"""Contractions that are compared."""
OTHER = "another program with its own cloud, law and sums"
SUMS = "the sums of Algorithm 1 beside piola"
NONE = "the paper prints no number"


@dataclass
class Model:
    """A way to have the energy of the patch."""

    name: str
    scene: str = "patch.toml"
    over: dict[str, Any] = field(default_factory=dict)
    reference: str = ""
    """Its name in the independent numbers."""
    stable: bool = True
    cheap: bool = True
    """Whether the short version has it."""


def _correspondence(**keys: str) -> dict[str, Any]:
    return {f"correspondence.{key}": value for key, value in keys.items()}


PAIRS = {"discretisation": "bond-quadrature"}
STABILISED = {"discretisation": "stabilised"}
MODELS = [
    Model("unstabilised, unit weight", reference="CC_one", stable=False),
    Model(
        "unstabilised, cubic spline",
        over=_correspondence(influence="cubic-spline"),
        reference="CC_cubic",
        stable=False,
        cheap=False,
    ),
    Model("stabilised (isotropic)", over=_correspondence(**STABILISED)),
    Model("stabilised (Wan)", over=_correspondence(**STABILISED, stabilisation="wan"), reference="CW_one", cheap=False),
    Model("quadrature at bonds, unit weight", over=_correspondence(**PAIRS), reference="BAQP_one"),
    Model(
        "quadrature at bonds, cubic spline",
        over=_correspondence(**PAIRS, influence="cubic-spline"),
        reference="BAQP_cubic",
        cheap=False,
    ),
    Model("bonds", scene="patch_bonds.toml", reference="BB"),
]
PLAIN, SPLINE, STIFFENED, WAN, QUADRATURE, _, BONDS = MODELS


@figure(PAPER, "Fig. 2", "a square in 444 quadrilaterals, and the cloud of their centres")
def fig02(run: Run) -> Found:
    nodes, corners = quads.read(run.path("patch.msh"))
    body = run.scene("patch_quads.toml").body()
    X, V = body.positions[:, :2], body.volumes
    count, edge, neighbours = published("Fig. 2")
    radii = own_radii(X, 12)
    own = families(X, V, radii)
    one_sided = len(own.i) - _mutual(own.i, own.j, len(X))
    counts = np.bincount(own.i, minlength=len(X))
    other, areas = cloud()
    best = min(quads.quality(nodes[one]) for one in corners)
    return Found(
        [
            Number("quadrilaterals", float(len(corners)), count),
            Number("particles", float(len(X)), count),
            Number("their areas together, m^2", float(V.sum()), edge**2, unit="m^2"),
            Number("neighbours with a radius for every particle, mean", float(counts.mean()), neighbours, reading=0.5),
            Claim(
                "every particle has its own radius (section 5.2.1)",
                "about 12 neighbours within it",
                f"{counts.min()} to {counts.max()}, radii from {radii.min():.3f} to {radii.max():.3f} m",
                bool(11 <= counts.min() and counts.max() <= 13),
            ),
            Number(
                "ordered pairs without their reverse",
                float(one_sided),
                why="the paper does not say what becomes of pairs of which one has the other in its family, and "
                "the other not; see Algorithm 1",
            ),
            Number("largest area over smallest", float(V.max() / V.min()), why=NONE),
        ],
        [
            Picture("444 quadrilaterals at random and their centres", sketches.points_and_quads(X, nodes[corners])),
            Picture(
                "the cloud of the independent program",
                sketches.points_and_mesh(other, sketches.neighbours(other), (-0.02, 1.02)),
            ),
        ],
        notes=f"""The paper does not print its cloud, and names its mesher in words. Here points at random are moved
        by twelve rounds of Lloyd to the centres of their Voronoi cells, joined to 888 Delaunay triangles, and these
        in pairs to 444 quadrilaterals by a matching of largest weight: 80 points on the edge and 405 inside give that
        number. The worst quadrilateral has an angle whose sine is {best:.2g}. On the right the cloud of the
        independent program, Voronoi cells of a square after two rounds, areas {areas.max() / areas.min():.2f} to 1,
        with which Fig. 3 is computed, since there are numbers for it.""",
    )


def _mutual(i: Whole, j: Whole, n: int) -> int:
    """Ordered pairs whose reverse is a pair, too."""
    return int(np.isin(i * n + j, j * n + i).sum())


def trajectories(run: Run) -> dict[str, Trajectory]:
    """Of all models, with the times of the pictures."""
    X, V = cloud()
    f = families(X, V, RADIUS)
    return {model.name: follow(run, model.scene, model.over, f, X) for model in MODELS if model.cheap or run.full}


@figure(PAPER, "Fig. 3", "the patch of 444 particles, stretched by 10 % and let go")
def fig03(run: Run) -> Found:
    found = trajectories(run)
    told = {one["model"]: one for one in reference("fracture_bars")["patch_of_444"]["ours"]}
    R = {name: one.over_contractions(one.disorder, COUNT) for name, one in found.items()}
    rows = [*_claims(run, found, R), *_ordered(run)]
    if run.full:
        rows += [*_full_claims(run, found, R), *_long(run), *_own_cloud(run)]
    for model in (one for one in MODELS if one.reference and one.name in found):
        rows += _compared(model, found[model.name], R[model.name], told[model.reference])
    rows += _states(run)
    X, _ = cloud()
    edges = sketches.neighbours(X)
    pictures: list[Any] = [
        Picture(
            f"{name}: contraction {k}, t = {one.t[one.contractions()[k - 1]]:.2f} s",
            sketches.points_and_mesh(one.x[k], edges),
        )
        for name, one in ((m.name, found[m.name]) for m in (STIFFENED, PLAIN))
        for k in (1, 3, 10)
    ]
    lines = [Line(name, one.t[1:].tolist(), one.disorder[1:].tolist(), style="-") for name, one in found.items()]
    steps = [
        Line(name, list(range(1, COUNT + 1)), values)
        for name, values in R.items()
        if name not in (WAN.name, MODELS[5].name)
    ]
    moments = [
        Line(m.name, found[m.name].t.tolist(), (found[m.name].moment / found[m.name].moment[0]).tolist(), style="-")
        for m in (PLAIN, STIFFENED, QUADRATURE, BONDS)
    ]
    pictures += [
        Panel("disorder R in time", "t, s", "R", lines, log="y"),
        Panel("mean over each contraction", "contraction", "R", steps, log="y"),
        Panel("contraction and expansion", "t, s", "second moment over that at the start", moments),
    ]
    return Found(rows, pictures, columns=3, notes=NOTES)


NOTES = f"""The cloud is that of the independent program; horizon 0.105 m (13.7 neighbours), plane strain, the law of
Algorithm 1, leap-frog with steps of {STEP:.4g} s, 4890 of them. The paper leaves open the coordinates, plane strain or
stress, and the step. R is the part of the distances of neighbours that no deformation gradient explains, over the
distances at rest, root mean squares weighted by volumes, and R_k its mean over the k-th contraction, which ends at the
k-th minimum of the second moment of area. The paper's stabilisation (derivatives of higher order, similar to Vidal,
Bonet, Huerta) has neither formula nor number in the text; here others take its place: the isotropic and Wan's stiffness
against deviations from the gradient, and quadrature at bonds. All are coherent, and so are plain bonds. The bars
(R > 0.3 in the first contraction and > 0.4 in the eighth without, below 0.12 with quadrature, 0.08 with bonds, 0.05
with Wan's stiffness) are those of the independent program, set before the runs. Samples are taken every fourth step
from the start, that program's one step later: taken so, the sums of Algorithm 1 have its R_1 to R_4 of the unstabilised
patch to all three digits. Its R_8 of 0.71 against 0.68 is another count of contractions: without stabilisation the
moment hardly swings and minima are shallow, and the same trajectory has 0.68 to 0.71 by how far around a minimum must
be the lowest. A start that differs by 1e-9 leaves all eight R to four digits."""


def _sums(run: Run, name: str, f: Families, watched: Families, X: Array) -> list[float]:
    """Disorder of `watched` over each contraction by the sums of Algorithm 1, a program beside piola."""
    one = move(run, name, f, peridynamic_forces, X, watched, 4890)
    return [float(one.disorder[a:b].mean()) for a, b in pairwise([0, *one.ends[:COUNT]])]


def _of_cloud(run: Run, weight: str) -> list[float]:
    """The same of the cloud, with the unit weight or a cubic spline."""
    X, V = cloud()
    unit = families(X, V, RADIUS)
    spline = replace(unit, w=cubic_spline(np.sqrt((unit.X**2).sum(1)), RADIUS, 2))
    return _sums(run, f"{weight} weight", spline if weight == "spline" else unit, unit, X)


def _claims(run: Run, found: dict[str, Trajectory], R: dict[str, list[float]]) -> list[Row]:
    plain, stiff = found[PLAIN.name], found[STIFFENED.name]
    last = [
        one.over_contractions(one.incoherent, COUNT)[-1] / one.over_contractions(one.kinetic, COUNT)[-1]
        for one in (plain, stiff)
    ]
    gaps = np.diff(stiff.t[stiff.contractions()])
    largest = {name: max(values) for name, values in R.items()}
    first = R[PLAIN.name][0] / R[STIFFENED.name][0]
    unit = _of_cloud(run, "unit")
    drift = max(one.drift for one in found.values())
    kept = max(max(one.momentum, one.turning) for name, one in found.items() if name != WAN.name)
    return [
        Claim(
            "motion of the stabilised patch",
            "contracts and expands periodically",
            f"from contraction to contraction {gaps.min():.2f} to {gaps.max():.2f} s, {len(gaps)} times in 30 s",
            bool(gaps.max() < 1.1 * gaps.mean() and gaps.min() > 0.9 * gaps.mean()),
        ),
        Claim(
            "unstabilised, after the first contraction",
            "disorder is seen already",
            f"R_1 = {R[PLAIN.name][0]:.2f}, {first:.0f} times that of the stabilised one",
            bool(R[PLAIN.name][0] > 0.3 and first > 4.0),
        ),
        Claim(
            "unstabilised, after eight contractions",
            "disorder is pronounced, motion all artefacts",
            f"R_8 = {R[PLAIN.name][-1]:.2f}, and {100 * last[0]:.0f} % of the kinetic energy is incoherent",
            bool(R[PLAIN.name][-1] > 0.4 and last[0] > 0.5),
        ),
        Claim(
            "stabilised, after eight contractions",
            "completely coherent",
            f"R_8 = {R[STIFFENED.name][-1]:.3f} isotropic, {R[QUADRATURE.name][-1]:.3f} quadrature at bonds; of the "
            f"former {100 * last[1]:.0f} % of the kinetic energy is incoherent",
            bool(R[STIFFENED.name][-1] < 0.05 and R[QUADRATURE.name][-1] < 0.12),
        ),
        Claim(
            "bonds (section 6)",
            "need no deformation gradient and do not suffer",
            f"R never above {largest[BONDS.name]:.3f} in eight contractions",
            largest[BONDS.name] < 0.08,
        ),
        Claim(
            "disorder without an update of the reference configuration (section 6)",
            "usually none before an update",
            f"R_1 = {R[PLAIN.name][0]:.2f} against the first configuration",
            R[PLAIN.name][0] < 0.05,
            refuted=abs(unit[0] / R[PLAIN.name][0] - 1.0) < AGREES,
            source=f"{SUMS}: R_1 = {unit[0]:.3f}",
            why="section 5 of the paper shows it without an update, too; the zero-energy modes are there at rest",
        ),
        Claim(
            "momentum and angular momentum (introduction)",
            "kept",
            f"{'both within 1e-12' if kept < 1e-12 else f'to {kept:.1g}'} of what points at their largest speed have",
            kept < 1e-12,
        ),
        Claim("energy over 30 s", "time steps are stable", f"kept to {100 * drift:.2f} % by all models", drift < 0.005),
    ]


def _full_claims(run: Run, found: dict[str, Trajectory], R: dict[str, list[float]]) -> list[Row]:
    """Of models that the short version has not."""
    spline, unit = R[SPLINE.name], R[PLAIN.name]
    other, sums = _of_cloud(run, "spline"), _of_cloud(run, "unit")
    return [
        Claim(
            "unstabilised, cubic spline in place of the unit weight (section 5.1)",
            "the weight can be chosen quite arbitrarily",
            f"R_1 = {spline[0]:.2f} against {unit[0]:.2f}, R_8 = {spline[-1]:.2f} against {unit[-1]:.2f}",
            bool(abs(spline[0] / unit[0] - 1.0) < 1.0 / 3.0),
            refuted=all(abs(a[0] / b[0] - 1.0) < AGREES for a, b in ((spline, other), (unit, sums))),
            source=f"{SUMS}: R_1 = {other[0]:.3f} against {sums[0]:.3f}",
            cheap=False,
            why="linear fields are exact with any weight (Eq. 16), but disorder does not grow alike (Fig. 5, too)",
        ),
        Number(
            "largest angular momentum with Wan's stiffness, over mass, half an edge and largest speed",
            found[WAN.name].turning,
            why="the paper says nothing of its own stabilisation; Wan's stiffness does not turn with the body, and "
            "makes angular momentum, the others keep it to rounding",
            cheap=False,
        ),
    ]


def _compared(model: Model, one: Trajectory, R: list[float], told: Any) -> list[Row]:
    """The numbers of the independent program for the same cloud; the paper prints none."""
    rows: list[Row] = [
        Number(
            f"R_{k}, {model.name}",
            R[k - 1],
            independent=told["R"][k - 1],
            source=OTHER,
            why=NONE,
            cheap=model.cheap,
        )
        for k in (1, 8)
    ]
    if model.stable:
        rows.append(
            Number(
                f"period, {model.name}",
                one.period(),
                unit="s",
                independent=told["period"],
                source=OTHER,
                why=NONE,
                cheap=model.cheap,
            )
        )
    return rows


def _states(run: Run) -> list[Row]:
    """After 20 steps, where two programs still have the same digits."""
    told = reference("fracture_bars")["patch_of_444"]["after_20_steps"]["models"]
    _, V = cloud()
    rows: list[Row] = []
    # Twenty steps are cheap, whatever the model.
    for model in (one for one in MODELS if one.reference in told):
        want = told[model.reference]

        def compute(model: Model = model) -> Any:
            over = {**model.over, "motion.end": 20.0 * STEP, "output.rows": 20, "output.every": 20.0 * STEP}
            result = run.scene(model.scene, over).run(progress=False)
            return {"u": result.displacement.tolist(), "stored": float(result.table("motion")["stored"][-1])}

        made = run.once("after20", compute, run.path(model.scene).read_text(), sorted(model.over.items()))
        u = np.array(made["u"])
        off = max(np.abs(u[int(k)] - np.array(w)).max() for k, w in want["u"].items()) / np.abs(u).max()
        square = float((V[:, None] * u**2).sum())
        same = (
            f"displacements of five points are those of the other program to {'1e-13' if off < 1e-13 else f'{off:.1g}'}"
        )
        rows += [
            Number(
                f"stored energy after 20 steps, {model.name}",
                made["stored"],
                unit="J",
                independent=want["stored"],
                source=OTHER,
                why=f"{NONE}; {same}",
            ),
            Number(
                f"sum of V u.u after 20 steps, {model.name}",
                square,
                unit="m^4",
                independent=want["sum_V_u2"],
                source=OTHER,
                why=NONE,
            ),
        ]
    return rows


def _long(run: Run) -> list[Row]:
    """Hundreds of oscillations of the stabilised patch."""
    X, V = cloud()
    f = families(X, V, RADIUS)
    values, count = {}, 0
    for model in (STIFFENED, WAN, QUADRATURE):
        # 330 s in as many frames as 30 s have otherwise.
        over = {**model.over, "motion.end": 330.0, "output.every": 0.1, "output.rows": 3300}
        one = follow(run, model.scene, over, f, X)
        count = len(one.contractions())
        values[model.name] = (float(one.disorder[-200:].mean()), one.drift)
    told = "; ".join(f"{name}: R = {R:.3f}, energy to {100 * drift:.2f} %" for name, (R, drift) in values.items())
    return [
        Claim(
            "stabilised, hundreds of oscillations",
            "still completely coherent",
            f"over the last 20 s of 330 s, some {count} contractions: {told}",
            all(R < 0.12 and drift < 0.005 for R, drift in values.values()) and count >= 200,
            cheap=False,
        )
    ]


def _ordered(run: Run) -> list[Row]:
    """The patch of 21 by 21 points on a lattice, without stabilisation."""
    body = run.scene("lattice.toml").body()
    X, V = body.positions[:, :2], body.volumes
    one = follow(run, "lattice.toml", {}, families(X, V, RADIUS), X)
    R = one.over_contractions(one.disorder, COUNT)
    f = families(X, V, RADIUS)
    other = _sums(run, "ordered", f, f, X)
    return [
        Claim(
            "unstabilised, ordered configuration",
            "easily simulated",
            f"a lattice of 21 by 21 points has R_1 = {R[0]:.3f}, R_8 = {R[-1]:.3f}",
            R[0] < 0.05 and R[-1] < 0.12,
            refuted=abs(other[-1] / R[-1] - 1.0) < AGREES,
            source=f"{SUMS}: R_1 = {other[0]:.3f}, R_8 = {other[-1]:.3f}",
            why=""
            if R[-1] < 0.12
            else "inner points have no force at the start (Eq. 16); what comes in are waves from "
            "the edges, whose points have half a family, and short ones have next to no stiffness (Section 6)",
        )
    ]


def _own_cloud(run: Run) -> list[Row]:
    """The cloud of Fig. 2 here: does the picture depend on the cloud?"""
    body = run.scene("patch_quads.toml").body()
    X, V = body.positions[:, :2], body.volumes
    f = families(X, V, RADIUS)
    R = []
    for model in (PLAIN, STIFFENED):
        one = follow(run, "patch_quads.toml", model.over, f, X)
        R.append(one.over_contractions(one.disorder, COUNT))
    return [
        Claim(
            "centres of 444 quadrilaterals, as the paper's cloud",
            "disorder unstabilised, coherence stabilised",
            f"R_1, R_8: {R[0][0]:.2f}, {R[0][-1]:.2f} unstabilised; {R[1][0]:.3f}, {R[1][-1]:.3f} stabilised",
            R[0][0] > 0.3 and R[0][-1] > 0.4 and R[1][-1] < 0.05,
            cheap=False,
        )
    ]
