"""How derivatives are taken, and what that costs: firooz2023, Figs. 3, 4 and 12, Tables 3 and 10."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from math import cos, exp, log, sin, tan

import numpy as np
import piola
from firooz2023.algebras import METHODS, errors
from firooz2023.pointwise import Body, Settings, clamp
from running import Run
from scipy.sparse.linalg import splu
from study import Claim, Found, Line, Number, Panel, Row, figure

PAPER = "firooz2023"


def newton_step(cells: int, hyper_dual: bool) -> list[float]:
    """Unknowns, and processor seconds to assemble and to solve one linear system: a quadrant of a square."""
    settings = Settings(2, cells, 3.0, c2=1e4, inside=1, outside=2, hyper_dual=hyper_dual)
    body = Body(settings)
    x = clamp(body, body.X.copy(), 0.02)
    times = []
    for _ in range(3):
        since = time.process_time()
        R, G = body.residual(x)
        matrix = body.tangent(G)
        assembled = time.process_time()
        splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.01).solve(
            -R[body.free]
        )
        times.append((assembled - since, time.process_time() - assembled))
    return [float(body.free.sum()), *(min(one[k] for one in times) for k in (0, 1))]


def newton_steps(sizes: tuple[int, ...], hyper_dual: bool) -> list[list[float]]:
    return [newton_step(cells, hyper_dual) for cells in sizes]


@figure(PAPER, "Fig. 3", "Assembly over solution, by hyper-dual numbers and in closed form")
def fig03(run: Run) -> Found:
    sizes = (20, 40, 80, 160, 240) if run.full else (10, 20)
    told = {
        name: run.once(f"step-{name}", partial(newton_steps, sizes, flag), sizes)
        for name, flag in (("hyper-dual", True), ("analytical", False))
    }
    # Both ways lead to the same linear systems: what solving one takes is the lesser of the two times.
    solution = [min(a[2], b[2]) for a, b in zip(*told.values(), strict=True)]
    lines = [
        Line(name, [one[0] for one in rows], [one[1] / s for one, s in zip(rows, solution, strict=True)], style=style)
        for (name, rows), style in zip(told.items(), ("bo-", "rs-"), strict=True)
    ]
    gap = [a - b for a, b in zip(lines[0].y, lines[1].y, strict=True)]
    rows: list[Row] = [
        Claim(
            "what the two assemble, a square of bonds and areas at random positions",
            "the same residuals and tangents",
            "equal to 1e-14 of the largest entry",
            same_derivatives() < 1e-14,
        )
    ]
    if run.full:
        rows.append(
            Claim(
                "the gap of the two ratios against the number of unknowns",
                "decreases",
                f"{gap[0]:.3g} at {lines[0].x[0]:.0f} unknowns, {gap[-1]:.3g} at {lines[0].x[-1]:.0f}",
                gap[-1] < 0.5 * gap[0] and all(b < 1.1 * a for a, b in pairwise(gap)),
                timed=True,
                cheap=False,
            )
        )
        cost = told["hyper-dual"][-1][1] / told["analytical"][-1][1]
        rows.append(
            Number(
                "assembly by hyper-dual numbers over that in closed form",
                cost,
                None,
                timed=True,
                cheap=False,
                why="the figure's axes are in no text",
            )
        )
    notes = """The paper states neither the problem nor the solver. Here it is the square of Fig. 5 with areas, one
        quadrant of it, in NumPy, once with derivatives in closed form and once with hyper-dual numbers as in its
        section 3, and a direct solution by SciPy's SuperLU. A direct solution grows faster than the assembly, so
        that both ratios, and with them their gap, fall. With piola's own kernels and solvers the ratio of the
        assemblies is constant (docs/measured/performance.md, "One Newton step": 5.4 to 6.0 from 2187 to 27783
        unknowns in space), and the gap of the ratios to the solution is as irregular as the change from a direct to
        an iterative solver makes it."""
    return Found(rows, [Panel("cost", "unknowns", "assembly / solution", lines, log="xy")], notes)


def same_derivatives() -> float:
    """Largest difference of residuals and of tangents by the two ways, over their largest entries."""
    settings = Settings(2, 8, 3.0, c2=30.0, n=2.0)
    body, other = Body(settings), Body(dataclasses.replace(settings, hyper_dual=True))
    moved = body.X + 0.1 * body.h * np.random.default_rng(1).standard_normal(body.X.shape) * (body.place > 0)
    pairs = zip(body.residual(moved), other.residual(moved), strict=True)
    return max(float(np.abs(a - b).max() / np.abs(a).max()) for a, b in pairs)


@figure(PAPER, "Fig. 4", "Seth's and Hill's strain, and the energy of a bond of unit length")
def fig04(run: Run) -> Found:
    powers = (-2.0, -1.0, 0.0, 1.0, 2.0)
    stretch = np.linspace(0.4, 1.8, 141)
    strains, energies, worst = [], [], 0.0
    for n in powers:
        strain = np.log(stretch) if n == 0 else (stretch**n - 1.0) / n
        psi = piola.Law("firooz2023", C1=1.0, n=n, dimension=3).psi(stretch, 1.0, measure="l")
        worst = max(worst, float(np.abs(psi - 0.5 * strain**2).max()))
        strains.append(Line(f"n = {n:g}", list(stretch), list(strain), style="-"))
        energies.append(Line(f"n = {n:g}", list(stretch), [float(one) for one in psi], style="-"))
    values = np.array([line.y for line in energies])
    short, long = stretch < 0.999, stretch > 1.001
    rows: list[Row] = [
        Claim(
            "energies below stretch 1",
            "smaller n has more",
            "so at every stretch from 0.4 on, n = -2 .. 2",
            bool((np.diff(values[:, short], axis=0) < 0).all()),
        ),
        Claim(
            "energies above stretch 1",
            "smaller n has less",
            "so at every stretch up to 1.8, n = -2 .. 2",
            bool((np.diff(values[:, long], axis=0) > 0).all()),
        ),
        Claim(
            "piola's kernel against (41), (42)",
            "psi1 = C1 |Xi| S1^2/2",
            f"largest difference {worst:.1e}",
            worst < 1e-13,
        ),
    ]
    notes = (
        "Neither the exponents nor the axes of the figure are in the text; n = 0, 1 and 2 are those of its examples."
    )
    return Found(
        rows, [Panel("strain", "stretch", "S1", strains), Panel("energy", "stretch", "psi1, J/m^6", energies)], notes
    )


# Function, its first and second derivative, and the sign and form of the e12 part as Table 3 prints it.
Table3 = tuple[
    str,
    Callable[[float], float],
    Callable[[float], float],
    Callable[[float], float],
    Callable[[float, float, float, float], tuple[float, float, float]],
]
N = 2.5
TABLE3: list[Table3] = [
    (
        "1/a",
        lambda a: 1 / a,
        lambda a: -1 / a**2,
        lambda a: 2 / a**3,
        lambda a, b, c, m: (-b / a**2, -c / a**2, -m / a**2 + 2 * b * c / a**3),
    ),
    (
        "a^n",
        lambda a: a**N,
        lambda a: N * a ** (N - 1),
        lambda a: N * (N - 1) * a ** (N - 2),
        lambda a, b, c, m: (
            N * b * a ** (N - 1),
            N * c * a ** (N - 1),
            -(N * m * a ** (N - 1) - N * (N - 1) * b * c * a ** (N - 2)),
        ),
    ),
    ("exp", exp, exp, exp, lambda a, b, c, m: (exp(a) * b, exp(a) * c, exp(a) * (m - b * c))),
    ("ln", log, lambda a: 1 / a, lambda a: -1 / a**2, lambda a, b, c, m: (b / a, c / a, m / a + b * c / a**2)),
    ("sin", sin, cos, lambda a: -sin(a), lambda a, b, c, m: (b * cos(a), c * cos(a), m * cos(a) - b * c * sin(a))),
    (
        "cos",
        cos,
        lambda a: -sin(a),
        lambda a: -cos(a),
        lambda a, b, c, m: (-b * sin(a), -c * sin(a), m * sin(a) + b * c * cos(a)),
    ),
    (
        "tan",
        tan,
        lambda a: 1 / cos(a) ** 2,
        lambda a: 2 * sin(a) / cos(a) ** 3,
        lambda a, b, c, m: (-b / cos(a) ** 2, c / cos(a) ** 2, m / cos(a) ** 2 + 2 * b * c * sin(a) / cos(a) ** 3),
    ),
]


@figure(PAPER, "Table 3", "Functions of hyper-dual numbers")
def table03(run: Run) -> Found:
    a, b, c, m = 0.7, 1.3, -0.4, 0.9
    rows: list[Row] = []
    for name, f, slope, bend, printed in TABLE3:
        h = 1e-4
        # Independent of the derivatives above: f along a + b s + c r + m s r, differenced in s and r.
        mixed = sum(p * q * f(a + b * p * h + c * q * h + m * p * q * h * h) for p in (1, -1) for q in (1, -1))
        ours = (slope(a) * b, slope(a) * c, slope(a) * m + bend(a) * b * c)
        by = mixed / (4 * h * h)
        given = printed(a, b, c, m)
        wrong = [unit for unit, x, y in zip(("e1", "e2", "e12"), ours, given, strict=True) if abs(x - y) > 1e-12]
        rows.append(
            Claim(
                f"{name} of a hyper-dual number",
                f"parts e1, e2, e12 are {given[0]:.4g}, {given[1]:.4g}, {given[2]:.4g} at (0.7, 1.3, -0.4, 0.9)",
                f"{ours[0]:.4g}, {ours[1]:.4g}, {ours[2]:.4g}" + (f"; wrong: {', '.join(wrong)}" if wrong else ""),
                not wrong,
                refuted=abs(by / ours[2] - 1.0) < 1e-5,
                source=f"central differences of the real function, e12 = {by:.4g}",
                why="" if not wrong else "signs of the text's formula do not obey the chain rule",
            )
        )
    notes = """The formulas are those of the paper's text; where its second unit is printed twice as e1 (1/a) or a plus
        stands before the unit (tan), the evident unit is taken. The results of the paper's own program show none of
        these signs: with them Newton's method would not be quadratic."""
    return Found(rows, notes=notes)


# As in Table 10: does psi' suffer by cancellation, by truncation, and psi''?
SUFFERS: dict[str, tuple[bool, bool, bool | None, bool | None]] = {
    "forward difference": (True, True, True, True),
    "backward difference": (True, True, True, True),
    "central difference": (True, True, True, True),
    "complex": (False, True, True, True),
    "hyper-complex": (False, True, False, True),
    "double": (False, True, True, True),
    "hyper-double": (False, True, False, True),
    "dual": (False, False, None, None),
    "hyper-dual": (False, False, False, False),
}


def suffering(name: str) -> tuple[bool, bool, bool | None, bool | None]:
    """As measured: cancels if the error is above 1e-9 at h = 1e-12, is truncated if it is above 1e-6 at h = 0.1."""
    small, large = errors(name, np.array([1e-12])), errors(name, np.array([0.1]))
    second = (None, None) if np.isnan(small[1][0]) else (small[1][0] > 1e-9, large[1][0] > 1e-6)
    return small[0][0] > 1e-9, large[0][0] > 1e-6, *second


@figure(PAPER, "Table 10", "Which method suffers from which error")
def table10(run: Run) -> Found:
    def words(flags: tuple[bool | None, ...]) -> str:
        return ", ".join({True: "suffers", False: "free", None: "-"}[one] for one in flags)

    rows: list[Row] = [
        Claim(
            f"{name}: psi' by cancellation, by truncation; psi'' likewise",
            words(SUFFERS[name]),
            words(suffering(name)),
            suffering(name) == SUFFERS[name],
        )
        for name in METHODS
    ]
    notes = """A method is said to cancel if more than 1e-9 of the derivative is lost at a step of 1e-12, and to be
        truncated if more than 1e-6 is at a step of 0.1; medians over 41 stretches. Logarithms are evaluated by
        angles and areas (atan, atanh). With the split into idempotents hyper-complex and hyper-double numbers would
        cancel, too."""
    return Found(rows, notes=notes)


@figure(PAPER, "Fig. 12", "Errors of derivatives of a logarithmic energy against the step")
def fig12(run: Run) -> Found:
    steps = np.logspace(-1, -20, 77)
    found = {name: errors(name, steps) for name in METHODS}
    lines: tuple[list[Line], list[Line]] = ([], [])
    for name, both in found.items():
        for k in (0, 1):
            if np.isfinite(both[k]).any():
                shown = [min(max(one, 1e-17), 1.0) for one in both[k]]
                lines[k].append(Line(name, list(steps), shown, style="-"))
    rows: list[Row] = []
    for name, orders in ORDERS.items():
        for k, label in ((0, "psi'"), (1, "psi''")):
            far, near = (errors(name, np.array([h]))[k][0] for h in (1e-2, 1e-3))
            rows.append(
                Number(
                    f"order of the error of {label} in the step, {name}",
                    float(np.log10(far / near)),
                    orders[k],
                    reading=0.05,
                )
            )
    spread = [max(found["hyper-dual"][k]) for k in (0, 1)]
    rows.append(
        Claim(
            "hyper-dual numbers at every step",
            "no truncation, no cancellation, whatever the step",
            f"at most {spread[0]:.1e} of psi', {spread[1]:.1e} of psi''",
            max(spread) < 4.5e-16,
        )
    )
    notes = """psi1 = C1 |Xi| ln(x/|Xi|)/2 as (A.2) prints it, without the square of (41); C1 = |Xi| = 1, medians of
        relative errors over 41 lengths from 0.6 to 3, none of which the paper states. Errors above 1 are drawn as
        1, below 1e-17 as that. Orders are slopes between steps of 1e-2 and 1e-3. The program
        examples/differentiation draws six of these methods, too, and compares with 512 bits; least errors here are
        the same within a factor of 1.2 wherever they are above rounding (forward 6.5e-9 and 1.0e-5, central 9.2e-12
        and 1.0e-8, complex 1.5e-8, double 1.4e-8)."""
    panels = [
        Panel(title, "step h", "relative error", list(one), log="xy")
        for title, one in zip(("first derivative", "second derivative"), lines, strict=True)
    ]
    return Found(rows, list(panels), notes)


# Powers of the step that (A.3) to (A.21) print behind psi' and psi''.
ORDERS: dict[str, tuple[float, float]] = {
    "forward difference": (1.0, 1.0),
    "backward difference": (1.0, 1.0),
    "central difference": (2.0, 2.0),
    "complex": (2.0, 2.0),
    "hyper-complex": (2.0, 2.0),
    "double": (2.0, 2.0),
    "hyper-double": (2.0, 2.0),
}
