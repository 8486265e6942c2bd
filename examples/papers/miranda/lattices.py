"""Bonds of lattices that are counted, not made, and what rounding makes of a shell at the horizon."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sources

Vector = NDArray[Any]


def printed(figure: str, line: str) -> float:
    """A single number of the paper."""
    return next(one.y for one in sources.printed("miranda", figure) if one.line == line)


def bonds(points: tuple[int, int, int], squared: int) -> int:
    """Pairs of a box of so many points whose distance squared is at most this, in spacings squared."""
    reach = int(np.sqrt(squared)) + 1
    axis = np.arange(-reach, reach + 1)
    steps = np.array(np.meshgrid(axis, axis, axis, indexing="ij")).reshape(3, -1).T
    lengths = (steps**2).sum(axis=1)
    near = np.abs(steps[(lengths > 0) & (lengths <= squared)])
    return int(np.prod(np.maximum(np.array(points) - near, 0), axis=1).sum() // 2)


@dataclass
class Lattice:
    """A model of the paper, with the shell of distance sqrt(12) spacings, at its horizon."""

    name: str
    points: tuple[int, int, int]
    spacing: float
    printed: int

    @property
    def within(self) -> int:
        """Bonds shorter than the horizon."""
        return bonds(self.points, 11)

    @property
    def shell(self) -> int:
        """Bonds as long as the horizon: four diagonals of each cube of two spacings."""
        return bonds(self.points, 12) - self.within

    @property
    def wanted(self) -> int:
        """How many of the shell the printed number counts."""
        return self.printed - self.within


LATTICES = [
    Lattice("A", (83, 7, 9), 0.05, 313_710),
    Lattice("B", (165, 13, 17), 0.025, 2_627_528),
    Lattice("cantilever", (77, 7, 9), 0.05, 290_934),
    Lattice("plate", (73, 53, 5), 0.0625, 1_204_382),
]

# Where the coordinates of an axis of n points a distance h apart come from, in the precision of h.
Axis = Callable[[int, Any], Vector]


def _added(first: float) -> Axis:
    def axis(n: int, h: Any) -> Vector:
        steps = np.full(n, h)
        steps[0] = type(h)(first) * h
        return np.cumsum(steps, dtype=type(h))

    return axis


def _shifted(by: float) -> Axis:
    return lambda n, h: (type(h)(by) + np.arange(n).astype(type(h)) * h).astype(type(h))


AXES: dict[str, Axis] = {
    "i h": lambda n, h: np.arange(n).astype(type(h)) * h,
    "(i + 1/2) h": lambda n, h: (np.arange(n).astype(type(h)) + type(h)(0.5)) * h,
    "(i + 1) h": lambda n, h: (np.arange(n).astype(type(h)) + type(h)(1)) * h,
    "h added up from 0": _added(0.0),
    "h added up from h/2": _added(0.5),
    "h added up from h": _added(1.0),
    "i L/(n - 1)": lambda n, h: np.arange(n).astype(type(h)) * (h * type(h)(n - 1)) / type(h)(n - 1),
    "i/(1/h)": lambda n, h: np.arange(n).astype(type(h)) / type(h)(round(1.0 / float(h), 9)),
    "i h - L/2": lambda n, h: np.arange(n).astype(type(h)) * h - h * type(h)(n - 1) / type(h)(2),
    "0.1 + i h": _shifted(0.1),
    "-0.3 + i h": _shifted(-0.3),
    "1.1 + i h": _shifted(1.1),
    "-L/2 + h added up": lambda n, h: np.cumsum(
        np.concatenate([[-h * type(h)(n - 1) / type(h)(2)], np.full(n - 1, h)]).astype(type(h)), dtype=type(h)
    ),
}


def _tests(h: Any) -> dict[str, Callable[[Vector, Vector, Vector], Vector]]:
    """Ways to ask whether a distance with these three parts squared is within the horizon."""
    real = type(h)
    delta = real(2) * np.sqrt(real(3)) * h
    short = real(round(2.0 * np.sqrt(3.0) * float(h), 4))
    return {
        "sqrt(r2) <= delta": lambda x, y, z: np.sqrt((x + y) + z) <= delta,
        "sqrt(r2) < delta": lambda x, y, z: np.sqrt((x + y) + z) < delta,
        "r2 <= delta^2": lambda x, y, z: (x + y) + z <= delta * delta,
        "r2 < delta^2": lambda x, y, z: (x + y) + z < delta * delta,
        "r2 <= 12 h^2": lambda x, y, z: (x + y) + z <= real(12) * h * h,
        "r2 <= delta^2, summed from behind": lambda x, y, z: x + (y + z) <= delta * delta,
        "sqrt(r2) <= delta, delta in four decimals": lambda x, y, z: np.sqrt((x + y) + z) <= short,
    }


def counted(lattice: Lattice, axis: Axis, precision: type[Any], unit: float = 1.0) -> dict[str, int]:
    """Bonds of the shell that each test keeps, with coordinates made alike along the three axes."""
    h = precision(lattice.spacing * unit)
    parts = []
    for n in lattice.points:
        at = axis(n, h)
        parts.append((at[2:] - at[:-2]) ** 2)
    # All four diagonals of a cube of two spacings have the same three parts.
    x, y, z = parts[0][:, None, None], parts[1][None, :, None], parts[2][None, None, :]
    return {name: 4 * int(test(x, y, z).sum()) for name, test in _tests(h).items()}


def search() -> list[tuple[str, list[int]]]:
    """Every way with what it keeps of the four shells."""
    found = []
    for precision in (np.float32, np.float64, np.longdouble):
        for unit in (1.0, 1000.0):
            for name, axis in AXES.items():
                counts = [counted(one, axis, precision, unit) for one in LATTICES]
                for test in counts[0]:
                    way = f"{precision.__name__}, {'m' if unit == 1.0 else 'mm'}, {name}, {test}"
                    found.append((way, [count[test] for count in counts]))
    return found


def noisy(lattice: Lattice, seed: int) -> int:
    """Bonds of the shell that are kept where every coordinate of every point is off by its own last digit."""
    random = np.random.default_rng(seed)
    at = np.stack(np.meshgrid(*[np.arange(n) * lattice.spacing for n in lattice.points], indexing="ij"), axis=-1)
    at = at + random.integers(-1, 2, at.shape) * np.spacing(np.maximum(at, lattice.spacing))
    delta = 2.0 * np.sqrt(3.0) * lattice.spacing
    kept = 0
    for dy in (2, -2):
        for dz in (2, -2):
            near = at[:-2, _part(dy, False), _part(dz, False)]
            far = at[2:, _part(dy, True), _part(dz, True)]
            kept += int((np.sqrt(((far - near) ** 2).sum(axis=-1)) <= delta).sum())
    return kept


def _part(step: int, far: bool) -> slice:
    return slice(2, None) if (step > 0) == far else slice(None, -2)
