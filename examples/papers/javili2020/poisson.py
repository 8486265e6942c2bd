"""Figs. 8 and 9: Poisson's ratio against the coefficients of areas and volumes, and of local elasticity."""

from __future__ import annotations

from typing import Any

import numpy as np

from firooz2023.pointwise import Settings, extension
from javili2020.local import ratio_at_centre
from running import Run
from sources import reference
from study import Claim, Found, Line, Number, Panel, Row, figure

PAPER = "javili2020"
# A coefficient without dimension is C2 delta^3/C1 in the plane and C3 delta^8/C1 in space.
POWER = {2: ("C2", 3), 3: ("C3", 8)}
LIMIT = {2: 1.0, 3: 0.5}
BONDS_ALONE = {2: 1.0 / 3.0, 3: 0.25}
BY = "sums over the neighbours of a lattice point (lattice_constants.json)"


def lattice(run: Run, d: int, spacings: float, k: float) -> dict[str, Any]:
    """Moduli of an endless lattice with this coefficient."""
    name, power = POWER[d]
    return run.scene("lattice.toml", {
        "body.box": [[0.0] * d, [1.0] * d],
        "horizon.spacings": spacings,
        f"material.parameters.{name}": k / (0.1 * spacings) ** power,
    }).moduli()


def poisson(run: Run, d: int, spacings: float, k: float) -> float:
    """Lateral contraction over extension, along an axis of the lattice."""
    return float(lattice(run, d, spacings, k)["nu"])


def local(d: int, ratio: float) -> float:
    """Poisson's ratio of a linear elastic body by lambda/mu: in d dimensions."""
    return ratio / (ratio + 2.0) if d == 2 else ratio / (2.0 * ratio + 2.0)


def local_ratio(d: int, nu: float) -> float:
    """lambda/mu of a linear elastic body with this Poisson's ratio."""
    return 2.0 * nu / (1.0 - nu) if d == 2 else 2.0 * nu / (1.0 - 2.0 * nu)


def auxetic_limit(run: Run, d: int, spacings: float) -> float:
    """The coefficient at which K = C11 + (d - 1) C12 vanishes. Moduli are linear in the coefficient."""

    def bulk(k: float) -> float:
        found = lattice(run, d, spacings, k)
        return float(found["C11"]) + (d - 1) * float(found["C12"])

    return -bulk(0.0) / (bulk(1.0) - bulk(0.0))


def recorded(d: int, spacings: float) -> float:
    """Poisson's ratio of bonds alone by the independent sums."""
    entries = reference("lattice_constants")["poisson_bulk"]
    return float(next(one["nu"] for one in entries if one["D"] == d and abs(one["ratio"] - spacings) < 1e-9))


def bonds_alone(run: Run, d: int, fine: float) -> list[Row]:
    """The ratio without areas and volumes, by how many spacings the horizon has."""
    word = "1/3" if d == 2 else "1/4"
    rows: list[Row] = [
        Number(
            f"nu at {POWER[d][0]} = 0, horizon of {m:g} spacings", poisson(run, d, m, 0.0), BONDS_ALONE[d], 0.0,
            independent=recorded(d, m), source=BY,
            why=f"{word} is the limit of endlessly many neighbours, which a lattice with few has not",
        )
        for m in (2.0, 3.0, 4.0)
    ]
    rows.append(Number(
        f"nu at {POWER[d][0]} = 0, horizon of {fine:g} spacings", poisson(run, d, fine, 0.0), BONDS_ALONE[d],
        correction=f"horizon of {fine:g} spacings, where a lattice comes near the continuum",
    ))
    return rows


def rows(run: Run, d: int, m: float, fine: float) -> list[Row]:
    """What section 4.3 says about one dimension, at a horizon of m spacings."""
    name, power = POWER[d]
    word = f"{name} delta^{power}/C1"
    relation = "lambda/(lambda + 2 mu)" if d == 2 else "lambda/(2 lambda + 2 mu)"
    ks = [0.0, 0.01, 0.1, 1.0, 10.0, 100.0, 1e4]
    nus = [poisson(run, d, m, k) for k in ks]
    lowest = auxetic_limit(run, d, m)
    least = poisson(run, d, m, 0.999 * lowest)
    same = [local_ratio(d, nu) for nu in nus[1:-1]]
    parts = [f"{k:g}: {ratio:.3g}" for k, ratio in zip(ks[1:-1], same, strict=True)]
    apart = max(max(k / ratio, ratio / k) for k, ratio in zip(ks[1:-1], same, strict=True))
    return [
        *bonds_alone(run, d, fine),
        Number("nu of local elasticity at lambda = mu", local(d, 1.0), BONDS_ALONE[d]),
        Number(f"nu at {word} = 1e4, horizon of {m:g} spacings", nus[-1], LIMIT[d]),
        Claim(
            "the whole range down to the auxetic limit", f"auxetic ratios, too, with {name} < 0",
            f"nu = {least:.4f} at {word} = {0.999 * lowest:.5f}; the bulk modulus vanishes at {lowest:.5f}",
            least < -0.98,
        ),
        Claim(
            "one ratio of coefficients for each nu", f"nu and {name}/C1 determine each other, as nu and lambda/mu do",
            f"nu rises from {nus[0]:.4f} to {nus[-1]:.6f} through {len(ks)} values of {word}",
            all(one < other for one, other in zip(nus[:-1], nus[1:], strict=True)),
        ),
        Claim(
            f"{name}/C1 is not lambda/mu", "the two are not equal where nu is",
            f"lambda/mu with the same nu, by {word}: {', '.join(parts)}; up to {apart:.3g} times apart",
            apart > 1.01,
        ),
    ] + ([
        Claim(
            "nu at C2/C1 = 0 and at lambda/mu = 0", "the same",
            f"{nus[0]:.5f} and {local(d, 0.0):g}; it is lambda/mu = {local_ratio(d, nus[0]):.4f} that has that nu",
            abs(nus[0] - local(d, 0.0)) < 0.01, refuted=True,
            source=f"the closed form {relation} that the paper prints itself has 0 at lambda = 0",
            why="lambda/mu = 1 must be meant, as a few sentences earlier",
        )
    ] if d == 2 else [])


def panels(run: Run, d: int, horizons: tuple[float, ...]) -> list[Panel]:
    """As in the paper: peridynamics on the left, local on the right; the upper row magnifies the lower."""
    name, power = POWER[d]
    count = 41 if run.full else 9
    made = []
    for title, high in (("magnified", 2.0), ("", 50.0)):
        lines = []
        for m in horizons:
            lowest = 0.99 * auxetic_limit(run, d, m)
            # The steep part lies at small coefficients, on both sides of zero.
            ks = [0.0, *lowest * np.linspace(0, 1, count)[1:], *high * np.linspace(0, 1, count)[1:] ** 2]
            ks = sorted(ks) if not title else [k for k in sorted(ks) if k >= 0.0]
            lines.append(Line(f"horizon of {m:g} spacings", ks, [poisson(run, d, m, k) for k in ks], style="-"))
        shown = np.linspace(0.0 if title else (-0.99 if d == 2 else -0.66), high, 201)
        made.append(Panel(f"CPD {title}", f"{name} delta^{power}/C1", "nu", lines))
        made.append(Panel(f"CCM {title}", "lambda/mu", "nu", [
            Line("local", list(shown), [local(d, float(one)) for one in shown], style="k-")
        ]))
    return made


def centre(run: Run, d: int, k: float) -> float:
    """Lateral contraction over extension by central differences at the centre of a clamped square or cube.

    The specimen is that of section 4.4 at a strain of 1e-6, its horizon 3 spacings of 0.05 or 2 of 0.1.
    """
    name, power = POWER[d]
    scene, spacing, delta = ("square.toml", 0.05, 0.15) if d == 2 else ("cube.toml", 0.1, 0.2)
    result = run.solve(scene, {
        "steps.end": 1e-6,
        "steps.increments": 1,
        "solver.tolerance": 1e-10,
        f"material.parameters.{name}": k / delta**power,
    })
    frame = result.frames[-1]
    X, u = frame.positions, frame["displacement"]

    def at(axis: int, sign: int) -> float:
        place = np.array([0.5, 0.5, 0.5 if d == 3 else 0.0])
        place[axis] += sign * spacing
        return float(u[np.argmin(np.abs(X - place).sum(axis=1)), axis])

    return -(at(1, 1) - at(1, -1)) / (at(0, 1) - at(0, -1))


def alone(d: int) -> float:
    """The same of bonds alone by the program beside piola, which needs no coefficients for it."""
    cells, m, layers = (20, 3.0, 3) if d == 2 else (10, 2.0, 2)
    specimen = Settings(d, cells, m, inside=layers, outside=0, rigid=True, increment=1e-5)
    _, body, x = extension(specimen, 1e-5, ())

    def moved(axis: int) -> float:
        beside = np.flatnonzero((body.place == np.eye(d, dtype=int)[axis]).all(axis=1))
        return float((x - body.X)[beside[0], axis])

    return -moved(1) / moved(0)


def specimens(run: Run, d: int) -> list[Row]:
    """The ratio as the paper measures it, of a body with held ends."""
    body, m = ("square", 3.0) if d == 2 else ("cube", 2.0)
    bonds = centre(run, d, 0.0)
    return [
        Number(
            f"nu at the centre of a clamped {body}, {POWER[d][0]} = 0, horizon of {m:g} spacings",
            bonds, BONDS_ALONE[d], independent=run.once("alone", lambda: alone(d), d), source="a program beside piola",
            why=f"an endless lattice of this horizon has {poisson(run, d, m, 0.0):.4f}, and clamps hinder contraction",
        ),
    ]


def small_families(run: Run) -> float:
    """The local ratio at the centre of the clamped square without finite elements: psi(F) with small families."""
    frame = run.solve("nearly_local.toml", {}).frames[-1]
    X, u = frame.positions, frame["displacement"]

    def apart(axis: int) -> float:
        ends = []
        for sign in (-1, 1):
            place = np.array([0.5, 0.5, 0.0])
            place[axis] += 0.05 * sign
            ends.append(float(u[np.argmin(np.abs(X - place).sum(axis=1)), axis]))
        return ends[1] - ends[0]

    return -apart(1) / apart(0)


def local_specimens(run: Run) -> list[Row]:
    """The local ratio at the centre of the square, with ends held across the extension and with ends that slide."""
    held, sliding = (run.once("centre", lambda: ratio_at_centre(40, held), held) for held in (True, False))
    why = f"clamps hinder contraction also of a local body: with ends that slide it has {sliding:.4f}"
    return [
        Number(
            "nu at the centre of a clamped square, local, lambda = mu", held, 1.0 / 3.0, why=why, cheap=False,
            independent=small_families(run), source="psi(F) with a horizon of 1/40",
        ),
        Number("nu at the centre of a square whose ends slide, local, lambda = mu", sliding, 1.0 / 3.0, cheap=False),
    ]


NOTES = """The paper gives neither horizon nor specimen, and C2/C1 or C3/C1 has a dimension: the abscissa is made
without one, C2 delta^3/C1 in the plane and C3 delta^8/C1 in space. Curves are of endless lattices, pulled along an
axis, which is what the centre of a large specimen does."""


@figure(PAPER, "Fig. 8", "Poisson's ratio of a plane against the stiffness of areas")
def fig08(run: Run) -> Found:
    horizons = (2.0, 3.0, 4.0) if run.full else (3.0,)
    found = rows(run, 2, 3.0, 32.0) + specimens(run, 2)
    if run.full:
        found += local_specimens(run)
    return Found(found, list(panels(run, 2, horizons)), NOTES, columns=2)


@figure(PAPER, "Fig. 9", "Poisson's ratio in space against the stiffness of volumes")
def fig09(run: Run) -> Found:
    horizons = (2.0, 3.0) if run.full else (2.0,)
    found = rows(run, 3, 3.0, 12.0) + specimens(run, 3)
    return Found(found, list(panels(run, 3, horizons)), NOTES, columns=2)
