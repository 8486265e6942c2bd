"""The zero-energy modes of section 6."""

from __future__ import annotations

from typing import Any

import numpy as np

from ganzenmueller2015.families import PAPER, Array, families
from ganzenmueller2015.stiffness import spectrum
from ganzenmueller2015.trajectory import LAMBDA, MU
from running import Run
from sources import reference
from study import AGREES, Claim, Found, Line, Number, Panel, Row, figure

NONE = "the paper prints no number"


@figure(PAPER, "Section 6", "zero-energy modes at rest")
def section06(run: Run) -> Found:
    told = {name: _modes(run, name) for name in SCENES}
    plain, rest = told["psi(F) at points"], {name: one for name, one in told.items() if name != "psi(F) at points"}
    inside, beside = _inside(run), _beside(run)
    rows: list[Row] = [
        Claim(
            "psi(F) at points, alternating displacements of an endless lattice",
            "a zero-energy mode",
            f"forces on inner points over those of bonds: {'below 1e-12' if inside < 1e-12 else f'{inside:.2g}'}",
            inside < 1e-12,
        ),
        Claim(
            "psi(F) at points, modes without energy of a body with edges",
            "rank deficient",
            f"{plain['zero']:.0f} beside the 3 rigid ones, of {plain['all']:.0f}; but {plain['soft']:.0f} below a "
            f"hundredth of the lowest of bonds, and {plain['below']:.0f} below that",
            plain["zero"] > 0,
            refuted=beside["zero"] == plain["zero"] and abs(beside["first"] / plain["first"] - 1.0) < AGREES,
            source=f"a program beside piola, with {beside['zero']:.0f}, and the lowest of the others as here",
            why="families at edges are one-sided, and see alternating displacements; the modes of a finite body have "
            "little energy, not none. It falls with the number of points: " + _falling(run),
        ),
        Claim(
            "bonds: modes without energy at rest",
            "no rank deficiency",
            f"{rest['bonds']['zero']:.0f} beside the rigid ones; {rest['bonds']['soft']:.0f} soft ones",
            rest["bonds"]["zero"] + rest["bonds"]["soft"] == 0,
        ),
        Claim(
            "linear peridynamic solid: modes without energy at rest",
            "rank deficiency is likely",
            f"{rest['linear peridynamic solid']['zero']:.0f} beside the rigid ones; "
            f"{rest['linear peridynamic solid']['soft']:.0f} soft ones",
            rest["linear peridynamic solid"]["zero"] + rest["linear peridynamic solid"]["soft"] > 0,
            refuted=_lps_refutes(),
            source="the dispersion relation of the endless lattice by another program: the "
            "wave of two spacings along an axis has omega^2 = 0 with psi(F) at points, and more than 0 with states",
            why="only the dilatation is a sum over the family; the deviatoric part is one of bonds, and no "
            "displacement leaves all bonds as they are",
        ),
        Claim(
            "stabilised and quadrature at bonds",
            "more accurate integration, or stiffness, mends it",
            "; ".join(
                f"{name}: {rest[name]['zero']:.0f} beside the rigid ones, {rest[name]['soft']:.0f} soft"
                for name in ("stabilised", "quadrature at bonds")
            ),
            all(rest[name]["zero"] + rest[name]["soft"] == 0 for name in ("stabilised", "quadrature at bonds")),
        ),
    ]
    rows += [
        Number(f"lowest omega^2 beside the rigid ones over the largest of bonds, {name}", one["first"], why=NONE)
        for name, one in told.items()
    ]
    lines = [Line(name, list(range(1, 101)), one["lowest"], style=".") for name, one in told.items()]
    return Found(
        rows,
        [Panel("lowest eigenvalues over the largest of bonds", "mode", "omega^2", lines, log="y")],
        notes="""A lattice of 12 by 12 points at rest, horizon of 3.015 spacings, E = 1 Pa, nu = 0.3 (bonds: E),
        unit weight. A mode counts as free where its omega^2 is below 1e-10 of the largest of bonds, as soft where it is
        below a hundredth of the lowest omega^2 of bonds that is not 0.""",
    )


SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "psi(F) at points": ("modes.toml", {}),
    "stabilised": ("modes.toml", {"correspondence.discretisation": "stabilised"}),
    "quadrature at bonds": ("modes.toml", {"correspondence.discretisation": "bond-quadrature"}),
    "bonds": ("modes_bonds.toml", {}),
    "linear peridynamic solid": (
        "modes_bonds.toml",
        {
            "material.potential": "linear_peridynamic_solid",
            "material.parameters": {"K": LAMBDA + 2.0 * MU / 3.0, "G": MU, "p": 0},
        },
    ),
}


def _eigenvalues(run: Run, name: str) -> Array:
    return _spectrum(run, *SCENES[name])


def _spectrum(run: Run, scene: str, over: dict[str, Any]) -> Array:
    """Eigenvalues of the tangent at rest over the masses, 1/s^2."""

    def compute() -> Any:
        body = run.scene(scene, over).body()
        mass = np.repeat(body.volumes, 2)
        K = body.energy(np.zeros((len(body.volumes), 2))).tangent().toarray()
        return np.linalg.eigvalsh(K / np.sqrt(mass[:, None] * mass[None, :])).tolist()

    return np.array(run.once("eigenvalues", compute, run.path(scene).read_text(), sorted(over.items(), key=str)))


def _beside(run: Run) -> dict[str, float]:
    """The same of psi(F) at points by a sum over families."""
    largest = _eigenvalues(run, "bonds").max()
    body = run.scene("modes.toml").body()
    mine = spectrum(families(body.positions[:, :2], body.volumes, 3.015 / 12.0), LAMBDA, MU)
    return {"zero": float((mine < 1e-10 * largest).sum() - 3), "first": float(mine[3] / largest)}


def _inside(run: Run) -> float:
    """Linear forces of alternating displacements on points that no edge reaches, over those of bonds."""
    largest = []
    for scene in ("modes.toml", "modes_bonds.toml"):
        body = run.scene(scene, {"body.spacing": 0.05}).body()
        X = body.positions[:, :2]
        alternating = (-1.0) ** np.round(X[:, :1] / 0.05 - 0.5) * np.array([[1.0, 0.0]])
        deep = (np.minimum(X, 1.0 - X) > 2.0 * 3.015 * 0.05).all(1)
        largest.append(np.abs(body.energy(np.zeros_like(X)).product(alternating)[deep]).max())
    return float(largest[0] / largest[1])


def _falling(run: Run) -> str:
    """The lowest of larger lattices."""
    told = []
    for n in (8, 12, 20):
        lowest = _spectrum(run, "modes.toml", {"body.spacing": 1.0 / n, "correspondence.influence": "cubic-spline"})
        largest = _spectrum(run, "modes_bonds.toml", {"body.spacing": 1.0 / n}).max()
        told.append(f"{lowest[3] / largest:.1e} of the largest of bonds with {n} by {n} points")
    return ", ".join(told) + " and a cubic spline"


def _modes(run: Run, name: str) -> dict[str, Any]:
    bonds, mine = _eigenvalues(run, "bonds"), _eigenvalues(run, name)
    largest = bonds.max()
    lowest = bonds[bonds > 1e-10 * largest].min()
    # The three rigid motions come first.
    zero, soft = mine < 1e-10 * largest, mine < 0.01 * lowest
    return {
        "zero": float(zero.sum() - 3),
        "soft": float((soft & ~zero).sum()),
        "below": float((mine < lowest).sum() - 3),
        "all": float(len(mine)),
        "first": float(mine[3] / largest),
        "lowest": np.maximum(mine[:100] / largest, 1e-18).tolist(),
    }


def _lps_refutes() -> bool:
    """Whether the other program has stiffness where psi(F) at points has none."""
    solid = reference("motion_small")["dispersion"]["solid"]
    least: dict[str, float] = {}
    for one in solid.values():
        rows = [row for row in one["rows"] if row[0] == "100" and abs(row[1] - np.pi) < 1e-9]
        for row in rows:
            least[one["model"]] = min(least.get(one["model"], np.inf), *row[3:])
    return bool(least.get("CC", 1.0) < 1e-10 and least.get("LPS", 0.0) > 1e-3)
