"""The compiled half; use `piola` itself."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

class Error(Exception):
    findings: list[dict[str, Any]]
    result: Any

def command(
    words: Sequence[str], progress: Callable[[float], object] | None = None
) -> tuple[int, str, str, str]: ...
def main(words: Sequence[str]) -> int: ...
def library() -> list[tuple[str, str]]: ...

class Law:
    def __init__(
        self,
        name: str,
        text: str,
        folder: str,
        settings: Sequence[tuple[str, float | str | list[float | str]]],
        dimension: int | None = None,
        delta: float | None = None,
    ) -> None: ...
    name: str
    dimension: int
    arguments: list[str]
    parameters: list[tuple[str, float, str | None]]
    def evaluate(self, measure: str, now: Vector, rest: Vector) -> tuple[Vector, Vector, Vector]: ...
    def evaluate_gradient(self, gradients: Vector) -> tuple[Vector, Vector]: ...

class Body:
    def __init__(self, scene: str, overrides: Sequence[str]) -> None: ...
    dimension: int
    positions: Vector
    volumes: Vector
    interactions: tuple[int, int, int]
    def evaluate(self, displacement: Vector) -> tuple[list[tuple[str, float]], Vector]: ...
    def tangent(self, displacement: Vector) -> tuple[Vector, Whole, Whole]: ...
    def products(self, displacement: Vector, vectors: Vector) -> Vector: ...

class Steps:
    def __init__(self, scene: str, overrides: Sequence[str]) -> None: ...
    shape: tuple[int, int]
    def next(self) -> tuple[float, int, float, Vector, Vector]: ...
    def set_loads(self, loads: Vector) -> None: ...
    def close(self) -> None: ...
