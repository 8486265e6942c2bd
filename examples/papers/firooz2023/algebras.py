"""The number systems of firooz2023, appendix A, and the derivatives of psi = C1 |Xi| ln(x/|Xi|)/2 by each.

Every system is the reals with two units e1, e2 of equal square: -1 (complex), +1 (double), 0 (dual). A value is the
array of its parts (real, e1, e2, e1 e2). Functions are evaluated by formulas without differences of large numbers,
not by splitting into idempotents.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[Array, Array]


def psi(x: Array) -> Array:
    """(A.2) as printed, without a square, with C1 = |Xi| = 1."""
    return 0.5 * np.log(x)


def exact(x: Array) -> Pair:
    return 0.5 / x, -0.5 / x**2


def hyper_complex(x: Array, h: float) -> Pair:
    """(A.13): ln(u + v i2) = ln(u^2 + v^2)/2 + i2 atan(v/u) with u, v complex numbers in i1."""
    u, v = x + 1j * h, np.full(x.shape, h, dtype=complex)
    part = 0.5 * np.arctan(v / u)
    return part.real / h, part.imag / h**2


def hyper_double(x: Array, h: float) -> Pair:
    """(A.21): ln(u + v e2) = ln(u^2 - v^2)/2 + e2 atanh(v/u) with u, v double numbers in e1."""
    size = x**2 - h**2
    p, q = h * x / size, -(h**2) / size
    # atanh(p + q e1) by the addition theorem of the hyperbolic tangent.
    real = 0.5 * np.arctanh(2.0 * p / (1.0 + p**2 - q**2))
    unit = 0.5 * np.arctanh(2.0 * q / (1.0 - p**2 + q**2))
    return 0.5 * real / h, 0.5 * unit / h**2


def complex_step(x: Array, h: float) -> Pair:
    """(A.8)."""
    value = 0.5 * np.log(x + 1j * h)
    return value.imag / h, 2.0 * (psi(x) - value.real) / h**2


def double(x: Array, h: float) -> Pair:
    """(A.16): ln(x + h e) = ln(x^2 - h^2)/2 + e atanh(h/x)."""
    real = 0.25 * np.log(x**2 - h**2)
    return 0.5 * np.arctanh(h / x) / h, 2.0 * (real - psi(x)) / h**2


def dual(x: Array, h: float) -> Pair:
    """(A.23), which has no second derivative."""
    return 0.5 * (h / x) / h, np.full(x.shape, np.nan)


def hyper_dual(x: Array, h: float) -> Pair:
    """(A.28): parts (a0, a1, a2, a12) = (x, h, h, 0) through the logarithm."""
    return 0.5 * (h / x) / h, 0.5 * (-(h / x) * (h / x)) / h**2


def forward(x: Array, h: float) -> Pair:
    """(A.3)."""
    return (psi(x + h) - psi(x)) / h, (psi(x + 2 * h) - 2 * psi(x + h) + psi(x)) / h**2


def backward(x: Array, h: float) -> Pair:
    """(A.4)."""
    return (psi(x) - psi(x - h)) / h, (psi(x) - 2 * psi(x - h) + psi(x - 2 * h)) / h**2


def central(x: Array, h: float) -> Pair:
    """(A.5)."""
    return (psi(x + h) - psi(x - h)) / (2 * h), (psi(x + h) - 2 * psi(x) + psi(x - h)) / h**2


METHODS: dict[str, Callable[[Array, float], Pair]] = {
    "forward difference": forward,
    "backward difference": backward,
    "central difference": central,
    "complex": complex_step,
    "hyper-complex": hyper_complex,
    "double": double,
    "hyper-double": hyper_double,
    "dual": dual,
    "hyper-dual": hyper_dual,
}


def errors(name: str, steps: Array) -> tuple[list[float], list[float]]:
    """Medians over 41 lengths from 0.6 to 3 of the relative error of psi' and psi''."""
    x = np.linspace(0.6, 3.0, 41)
    truth = exact(x)
    found: tuple[list[float], list[float]] = ([], [])
    with np.errstate(all="ignore"):
        for h in steps:
            for k, value in enumerate(METHODS[name](x, float(h))):
                error = np.abs(value / truth[k] - 1.0)
                found[k].append(float(np.median(np.where(np.isfinite(error), error, 1.0 if k == 0 else np.nan))))
    return found
