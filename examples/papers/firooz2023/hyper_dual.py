"""Hyper-dual numbers as firooz2023, section 3, has them, of arrays; and the derivatives of its energies by them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class HyperDual:
    """a0 + a1 e1 + a2 e2 + a12 e12 with e1^2 = e2^2 = 0."""

    a0: Array
    a1: Array
    a2: Array
    a12: Array

    def __add__(self, other: HyperDual) -> HyperDual:
        return HyperDual(self.a0 + other.a0, self.a1 + other.a1, self.a2 + other.a2, self.a12 + other.a12)

    def __mul__(self, other: HyperDual) -> HyperDual:
        a, b = self, other
        mixed = a.a0 * b.a12 + a.a1 * b.a2 + a.a2 * b.a1 + a.a12 * b.a0
        return HyperDual(a.a0 * b.a0, a.a0 * b.a1 + a.a1 * b.a0, a.a0 * b.a2 + a.a2 * b.a0, mixed)

    def scaled(self, by: Any) -> HyperDual:
        return HyperDual(by * self.a0, by * self.a1, by * self.a2, by * self.a12)

    def shifted(self, by: float) -> HyperDual:
        return HyperDual(self.a0 + by, self.a1, self.a2, self.a12)

    def function(self, f: Any, slope: Any, bend: Any) -> HyperDual:
        """Of a function with its first and second derivative at a0: the chain rule."""
        return HyperDual(f, slope * self.a1, slope * self.a2, slope * self.a12 + bend * self.a1 * self.a2)

    def power(self, n: float) -> HyperDual:
        a = self.a0
        return self.function(a**n, n * a ** (n - 1.0), n * (n - 1.0) * a ** (n - 2.0))

    def log(self) -> HyperDual:
        return self.function(np.log(self.a0), 1.0 / self.a0, -1.0 / self.a0**2)


def energy(ratio: HyperDual, n: float) -> HyperDual:
    """S^2/2 with Seth's and Hill's strain."""
    strain = ratio.log() if n == 0 else ratio.power(n).shifted(-1.0).scaled(1.0 / n)
    return (strain * strain).scaled(0.5)


def scalar(ratio: Array, n: float) -> tuple[Array, Array]:
    """First and second derivative of S^2/2 by the ratio."""
    one = np.ones_like(ratio)
    found = energy(HyperDual(ratio, one, one, 0.0 * one), n)
    return found.a1, found.a12


def radial(a: Array, size: Any, n: float) -> tuple[Array, Array]:
    """Gradient and Hessian by the vector a of size S(|a|/size)^2/2: an evaluation for each pair of components."""
    gradient, hessian = np.zeros_like(a), np.zeros((*a.shape, 3))
    zero = np.zeros(a.shape[:-1])
    for i in range(3):
        for j in range(i + 1):
            parts = [HyperDual(a[..., k], zero + float(k == i), zero + float(k == j), zero) for k in range(3)]
            square = parts[0] * parts[0] + parts[1] * parts[1] + parts[2] * parts[2]
            found = energy(square.power(0.5).scaled(1.0 / size), n).scaled(size)
            gradient[..., i] = found.a1
            hessian[..., i, j] = hessian[..., j, i] = found.a12
    return gradient, hessian
