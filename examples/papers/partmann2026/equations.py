"""Equations of the paper that are looked at by themselves: (3.58), (4.31) and (4.33), (4.49)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from running import Run
from study import Claim, Found, Line, Number, Panel, Row, figure

from partmann2026.published import ANOTHER, PAPER

Values = NDArray[np.float64]

REACH = 3.015
BULK, LAMBDA, MU = 140.0, 84.0, 84.0

BLOCK: dict[str, tuple[dict[str, object], float]] = {
    # Scene, and the critical step over (3.58) by another program.
    "BB": ({"material.potential": "silling2000", "material.parameters": {"K": BULK}}, 2.06),
    "OSB, constant": ({
        "material.potential": "linear_peridynamic_solid", "material.parameters": {"K": BULK, "G": MU, "p": 0},
    }, 1.90),
    "CC, constant": ({"correspondence.discretisation": "nodal", "correspondence.influence": "constant"}, 2.39),
    "CC, cubic": ({"correspondence.discretisation": "nodal"}, 1.56),
    "CW, constant": ({
        "correspondence.discretisation": "stabilised", "correspondence.stabilisation": "wan",
        "correspondence.influence": "constant",
    }, 1.35),
    "CW, cubic": ({
        "correspondence.discretisation": "stabilised", "correspondence.stabilisation": "wan",
    }, 0.84),
    "BAQP, constant": ({"correspondence.influence": "constant"}, 2.34),
    "BAQP, cubic": ({}, 1.46),
}


def estimate() -> float:
    """(3.58) inside a lattice of unit spacing with the density of the block, in s."""
    family = [np.array(x) - 3.0 for x in np.ndindex(7, 7, 7)]
    lengths = [float(np.sqrt(x @ x)) for x in family]
    bond = 18.0 * BULK / (math.pi * REACH**4)
    return math.sqrt(2.0 * 8.0 / sum(bond / length for length in lengths if 0.0 < length <= REACH))


@figure(PAPER, "Eq. 3.58", "the step of explicit motions")
def eq358(run: Run) -> Found:
    base = estimate()
    rows: list[Row] = []
    ratios = {}
    for name, (scene, theirs) in BLOCK.items():
        summary = run.solve("block.toml", {**scene, "motion.end": 0.2 * base, "output.frames": 1}, threads=1).summary
        ratios[name] = float(summary["motion"]["critical_step_seconds"]) / base
        rows.append(Number(
            f"critical step over (3.58), {name}", ratios[name], None, independent=theirs, source=ANOTHER,
            why="the paper prints none",
        ))
    least = min(ratios, key=lambda name: ratios[name])
    rows.append(Claim(
        "(3.58) for all models", "the critical step", f"the largest stable step is {ratios[least]:.2f} of it for "
        f"{least}, {max(ratios.values()):.2f} for others", all(ratio >= 1.0 for ratio in ratios.values()), refuted=True,
        source="0.84 for CW with the cubic kernel by another program",
        why="it is made of the bond constant and knows neither kernel nor stabilisation; it is on the safe side for "
        "all models but CW with the cubic kernel, and no safety factor is printed",
    ))
    return Found(rows, [], """A free block of 10 x 10 x 10 points at rest; the largest frequency is found from exact
    products with the tangent. The paper does not say what factor stands before (3.58) in its runs.""")


@figure(PAPER, "Eq. 4.33", "forces of BAQP")
def eq433(run: Run) -> Found:
    box = [[0, 0, 0], [5, 4, 4]]
    body = run.scene("block.toml", {"body.box": box, "correspondence.influence": "constant"}).body()
    u = 0.02 * np.random.default_rng(7).standard_normal(body.positions.shape)
    exact = body.energy(u).forces
    largest = np.abs(exact).max()
    off = {power: float(np.abs(forces(body.positions, u, power) - exact).max() / largest) for power in (2, 1)}
    rows: list[Row] = [
        Claim("(4.29) to (4.31), |dX|^2 below", "the force state of BAQP",
              f"the exact gradient of the energy (4.25) but for {off[2]:.0e} of the largest force", off[2] < 1e-10,
              correction="signs as in t(X, X') - t(X', X); Psi in place of Psi/V' where it has no volume in it"),
        Claim("(4.33), |dX| below", "the same force state",
              f"misses the gradient of the energy by {100 * off[1]:.0f} % of the largest force", off[1] < 1e-10,
              refuted=True, source="the exact gradient, and (4.31) of the paper",
              why="the unit vector would give a term with the dimension of another"),
    ]
    return Found(rows, [], """Forces of 80 points with a spacing of 1 m that are moved at random by 2 % of it; the
    constant kernel, Saint Venant and Kirchhoff's law. With another unit of length the error of (4.33) is another.""")


def forces(places: Values, u: Values, power: int) -> Values:
    """(4.21) to (4.32) with |dX| to that power under the first term; volumes are 1, in N."""
    n = len(places)
    X = places[None, :, :] - places[:, None, :]
    x = X + u[None, :, :] - u[:, None, :]
    squares = (X * X).sum(axis=2)
    near = (squares > 0.0) & (squares <= REACH**2)
    # Constant kernel: all neighbours alike.
    shape = np.einsum("ij,ija,ijb->iab", near, X, X)
    psi = near[:, :, None] * np.einsum("iab,ijb->ija", np.linalg.inv(shape), X)
    F = np.einsum("ija,ijb->iab", x, psi)
    mean = 0.5 * (F[:, None] + F[None, :])
    safe = np.where(near, squares, 1.0)
    bond = mean + np.einsum("ija,ijb->ijab", x - np.einsum("ijab,ijb->ija", mean, X), X) / safe[:, :, None, None]
    strain = 0.5 * (np.einsum("ijca,ijcb->ijab", bond, bond) - np.eye(3))
    stress = LAMBDA * np.trace(strain, axis1=2, axis2=3)[:, :, None, None] * np.eye(3) + 2.0 * MU * strain
    count = near.sum(axis=1)
    weight = near * 0.5 * (1.0 / count[:, None] + 1.0 / count[None, :])
    P = weight[:, :, None, None] * (bond @ stress)
    along = np.einsum("ijab,ijb->ija", P, X)
    Z = P.sum(axis=1) - np.einsum("ija,ijb->iab", along / safe[:, :, None], X)
    t = along / safe[:, :, None] ** (0.5 * power) + np.einsum("iab,ijb->ija", Z, psi)
    assert t.shape == (n, n, 3)
    found: Values = (t - t.transpose(1, 0, 2)).sum(axis=1)
    return found


@figure(PAPER, "Eq. 4.49", "the rotation of Flanagan and Taylor over a step")
def eq49(run: Run) -> Found:
    angles = [0.1, 0.2, 0.3, 0.5, 1.0]
    printed, plus = ([off_orthogonal(angle, sign) for angle in angles] for sign in (-1.0, 1.0))
    rows: list[Row] = [
        Claim(
            "Q as printed, with a minus before (1 - cos) W^2/w^2", "a rotation",
            f"Q'Q - 1 = {printed[2]:.2f} (2-norm) at an angle of 0.3", max(printed) < 1e-12, refuted=True,
            source=f"Rodrigues' formula, which has a plus: {max(plus):.0e}",
        ),
        Claim("Q with a plus", "a rotation", f"Q'Q - 1 = {max(plus):.0e}", max(plus) < 1e-12,
              correction="a plus before the last term of (4.49)"),
    ]
    notes = """No figure of the paper is computed with this update, nor with the subdomain of Chen and Spencer (4.15) to
    (4.20), of which the text says that it was left out after difficulties; it gives no value of its radius. Both are
    updates of forces and no energies. With the printed sign lengths across the axis shrink or grow by about half of the
    squared angle in every step, so that a program with it would be seen to fail: presumably a misprint."""
    return Found(rows, [Panel("how far from orthogonal", "angle of a step, rad", "Q'Q - 1", [
        Line("as printed", angles, printed), Line("with a plus", angles, [max(one, 1e-17) for one in plus]),
    ], log="xy")], notes)


def off_orthogonal(angle: float, sign: float) -> float:
    """2-norm of Q'Q - 1 with that sign in front of the last term of (4.49), about an axis along no coordinate."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    w = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    q = np.eye(3) + math.sin(angle) * w + sign * (1.0 - math.cos(angle)) * w @ w
    return float(np.linalg.norm(q.T @ q - np.eye(3), 2))
