"""Potentials on arrays."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _piola
from ._errors import Error, command

Array = NDArray[np.float64]
Value = float | str | Sequence[float | str]

_LIBRARY = dict(_piola.library())


def library() -> list[str]:
    """Names of the potentials that come with piola."""
    return sorted(_LIBRARY)


def setting(name: str, value: Any) -> float | str | list[float | str]:
    """A number, a text with a unit, or a list of them."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, str):
        return value
    if isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, (Sequence, np.ndarray)):
        entries = [setting(name, one) for one in value]
        if entries and not any(isinstance(one, list) for one in entries):
            return [one for one in entries if not isinstance(one, list)]
    raise Error(f"`{name}` is a number, a text with a unit, or a sequence of them, not {value!r}")


class Law:
    """A potential with values of its parameters.

    `source` is a name of the library, a path that ends in `.piola`, or the text of a potential. Parameters are
    numbers in the declared unit, texts with a unit (`mu="2 MPa"`), or sequences for vectors; those whose names
    Python keeps for itself stand in `values`, `{"lambda": 1e9}`. Without a `dimension` it is the largest that
    the potential is defined in; `delta` is the horizon in m, for energies that depend on it.
    """

    def __init__(
        self,
        source: str | os.PathLike[str],
        values: Mapping[str, Value] | None = None,
        *,
        dimension: int | None = None,
        delta: float | None = None,
        **parameters: Value,
    ) -> None:
        source = os.fspath(source)
        folder = "."
        if "\n" in source:
            name, text = "law.piola", source
        elif source in _LIBRARY:
            name, text = source, _LIBRARY[source]
        elif source.endswith(".piola"):
            with open(source, encoding="utf-8") as file:
                name, text = source, file.read()
            folder = os.path.dirname(source) or "."
        else:
            known = ", ".join(library())
            raise Error(
                f"`{source}` is neither a name of the library ({known}), nor a path that ends in .piola, "
                "nor the text of a potential, which has several lines",
            )
        twice = set(values or {}) & set(parameters)
        if twice:
            raise Error(f"`{twice.pop()}` is given twice")
        self.given: dict[str, Any] = {**(values or {}), **parameters}
        """Parameters as they were given."""
        settings = [(key, setting(key, value)) for key, value in self.given.items()]
        self.text = text
        self._name, self._folder = name, os.path.abspath(folder)
        self._dimension, self._delta = dimension, delta
        self._settings = settings
        self._law = self._compiled()

    def _compiled(self) -> _piola.Law:
        given = (self._settings, self._dimension, self._delta)
        return _piola.Law(self._name, self.text, self._folder, *given)

    def __getstate__(self) -> dict[str, Any]:
        # Machine code is of this process: where the law is read it is compiled anew.
        return {key: value for key, value in self.__dict__.items() if key != "_law"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._law = self._compiled()

    @property
    def name(self) -> str:
        """The name that the potential gives itself."""
        return self._law.name

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self._law.dimension

    @property
    def arguments(self) -> list[str]:
        """What its energies are of: `l`, `a`, `v`, `F` and others."""
        return self._law.arguments

    @property
    def parameters(self) -> dict[str, float]:
        """Values of its parameters in SI units."""
        return {name: value for name, value, _ in self._law.parameters}

    @property
    def units(self) -> dict[str, str | None]:
        """Units of its parameters as they are declared."""
        return {name: unit for name, _, unit in self._law.parameters}

    def _measure(self, measure: str | None) -> str:
        if measure is not None:
            return measure
        known = [one for one in self.arguments if one in ("l", "a", "v")]
        if len(known) == 1:
            return known[0]
        if not known:
            raise Error(f"`{self.name}` has no energy of a measure, but of {', '.join(self.arguments)}")
        raise Error(
            f"`{self.name}` has energies of {', '.join(self.arguments)}: say which is meant, measure=\"l\""
        )

    def derivatives(
        self, now: ArrayLike, rest: ArrayLike = 1.0, measure: str | None = None
    ) -> tuple[Array, Array, Array]:
        """psi, psi' and psi'' of measures, and measures at rest, which are broadcast together.

        Lengths in m, areas (twice those of triangles) in m^2, volumes (six times those of tetrahedra) in m^3.
        """
        l = np.asarray(now, dtype=np.float64)
        r = np.asarray(rest, dtype=np.float64)
        if r.size == 1:
            shape, r = l.shape, r.reshape(1)
        else:
            l, r = np.broadcast_arrays(l, r)
            shape, r = l.shape, np.ascontiguousarray(r).reshape(-1)
        flat = np.ascontiguousarray(l).reshape(-1)
        found = self._law.evaluate(self._measure(measure), flat, r)
        psi, d1, d2 = (column.reshape(shape) for column in found)
        return psi, d1, d2

    def psi(self, now: ArrayLike, rest: ArrayLike = 1.0, measure: str | None = None) -> Array:
        """The energy of measures, or of deformation gradients `(.., d, d)` where it is one of F."""
        if measure == "F" or (measure is None and self.arguments == ["F"]):
            return self._gradient(now)[0]
        return self.derivatives(now, rest, measure)[0]

    def d1(self, now: ArrayLike, rest: ArrayLike = 1.0, measure: str | None = None) -> Array:
        """The first derivative by the measure: of a bond's energy its force."""
        return self.derivatives(now, rest, measure)[1]

    def d2(self, now: ArrayLike, rest: ArrayLike = 1.0, measure: str | None = None) -> Array:
        """The second derivative by the measure."""
        return self.derivatives(now, rest, measure)[2]

    def P(self, F: ArrayLike) -> Array:
        """The first Piola-Kirchhoff stress of deformation gradients `(.., d, d)`, in Pa."""
        return self._gradient(F)[1]

    def _gradient(self, F: ArrayLike) -> tuple[Array, Array]:
        tensors = np.asarray(F, dtype=np.float64)
        d = self.dimension
        if tensors.shape[-2:] != (d, d):
            raise Error(f"gradients have the shape (.., {d}, {d}), not {tensors.shape}")
        psi, P = self._law.evaluate_gradient(np.ascontiguousarray(tensors).reshape(-1))
        return psi.reshape(tensors.shape[:-2]), P.reshape(tensors.shape)

    def derive(self, emit: str = "text") -> str:
        """Energy and derivatives as text: `text`, `latex`, `c`, `graph` and others, as `piola derive` has them."""
        with _file(self) as path:
            words = ["derive", path, "--emit", emit, "--dim", str(self.dimension)]
            words += ["--delta", repr(self._delta)] if self._delta is not None else []
            for key, value in self._settings:
                values = value if isinstance(value, list) else [value]
                words += ["--set", f"{key}={','.join(str(one) for one in values)}"]
            return command(words)[1]

    @property
    def latex(self) -> str:
        """The energies and their derivatives in LaTeX."""
        return self.derive("latex")

    def _repr_latex_(self) -> str:
        return self.latex

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value:g}" for name, value in self.parameters.items())
        energies = ", ".join(f"psi({argument})" for argument in self.arguments)
        return f"<Law {self.name}: {energies}; {given}>"


class _file:
    """The potential as a file, for commands: its own, or one that is gone afterwards."""

    def __init__(self, law: Law) -> None:
        self._law = law
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> str:
        law = self._law
        if law._name != "law.piola" and (law._name in _LIBRARY or os.path.exists(law._name)):
            return law._name
        self._folder = tempfile.TemporaryDirectory(prefix="piola-")
        path = os.path.join(self._folder.name, "law.piola")
        with open(path, "w", encoding="utf-8") as file:
            file.write(law.text)
        return path

    def __exit__(self, *_: object) -> None:
        if self._folder is not None:
            self._folder.cleanup()
