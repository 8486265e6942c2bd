"""Scenes: what a body is, what it stores, what is done to it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _piola, _toml
from ._errors import Error, command
from ._frames import Frame, read_frames

Array = NDArray[np.float64]
Overrides = Mapping[str, Any]


class _Folder:
    """A folder that is gone with whoever has it. Pickled it is its files, and another folder where it is read."""

    def __init__(self) -> None:
        self.path = tempfile.mkdtemp(prefix="piola-")
        self._gone = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def __getstate__(self) -> dict[str, bytes]:
        files = {}
        for below, _, names in os.walk(self.path):
            for name in names:
                path = os.path.join(below, name)
                with open(path, "rb") as file:
                    files[os.path.relpath(path, self.path)] = file.read()
        return files

    def __setstate__(self, files: dict[str, bytes]) -> None:
        self.__init__()  # type: ignore[misc]
        for name, content in files.items():
            path = os.path.join(self.path, name)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "wb") as file:
                file.write(content)


class Scene:
    """A scene: the path of a TOML file, or its tables as a dict.

    Files that a dict names are relative to `folder`; a potential may be a `Law` or the text of one. Overrides
    are keys with dots, `{"body.spacing": 0.1}`, and parameters of [material] by their names, `C1=2.0`; those
    given here hold for every call, those given to a call hold for it.
    """

    def __init__(
        self,
        source: str | os.PathLike[str] | Mapping[str, Any],
        overrides: Overrides | None = None,
        *,
        folder: str | os.PathLike[str] = ".",
        **parameters: Any,
    ) -> None:
        self._written: _Folder | None = None
        if isinstance(source, Mapping):
            self._written = _Folder()
            self.path = _toml.write_scene(source, self._written.path, os.fspath(folder))
        else:
            self.path = os.path.abspath(source)
        self._overrides = _toml.overrides(overrides, parameters)

    def __deepcopy__(self, _: dict[int, Any]) -> Scene:
        # Scenes do not change: a copy shares the file.
        copied = object.__new__(Scene)
        copied.__dict__.update(self.__dict__)
        return copied

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self._written is not None:
            self.path = os.path.join(self._written.path, os.path.basename(self.path))

    def _words(self, overrides: Overrides | None, parameters: Mapping[str, Any]) -> list[str]:
        return self._overrides + _toml.overrides(overrides, parameters)

    def _set(self, overrides: Overrides | None, parameters: Mapping[str, Any]) -> list[str]:
        words = self._words(overrides, parameters)
        return [word for one in words for word in ("--set", one)]

    def check(self, overrides: Overrides | None = None, **parameters: Any) -> None:
        """Looks for mistakes, without a run; mistakes are an `Error`, what should be known is a warning."""
        command(["check", self.path, *self._set(overrides, parameters)])

    def run(
        self,
        out: str | os.PathLike[str] | None = None,
        overrides: Overrides | None = None,
        *,
        threads: int | None = None,
        force: bool = False,
        progress: bool | Callable[[float], object] | None = None,
        **parameters: Any,
    ) -> Result:
        """Solves it. Without `out` the results live as long as the `Result`.

        `progress` is told how far the run is, from 0 to 1; `True` shows a bar of tqdm, and without a word
        there is one where tqdm is and a person looks on. KeyboardInterrupt ends the run after its step. An
        `Error` of a run that left files, because it did not converge or its end is not stable, has them as
        `result`.
        """
        kept = None
        if out is None:
            kept = _Folder()
            out = os.path.join(kept.path, "out")
        words = ["run", self.path, "--out", os.fspath(out), *self._set(overrides, parameters)]
        words += ["--threads", str(threads)] if threads else []
        words += ["--force"] if force else []
        with _bar(progress) as tell:
            try:
                command(words, tell)
            except Error as failed:
                if os.path.exists(os.path.join(out, "summary.json")):
                    failed.result = Result(os.fspath(out), kept)
                raise
        return Result(os.fspath(out), kept)

    def steps(self, overrides: Overrides | None = None, **parameters: Any) -> Iterator[Step]:
        """Its load steps one by one: the loop looks at each, and may give loads for those to come."""
        steps = _piola.Steps(self.path, self._words(overrides, parameters))
        shape = steps.shape
        loads = np.zeros(shape)
        try:
            while True:
                try:
                    t, iterations, energy, u, residual = steps.next()
                except StopIteration:
                    return
                step = Step(t, iterations, energy, u.reshape(shape), residual.reshape(shape), loads)
                yield step
                given = np.asarray(step.loads, dtype=np.float64)
                if given.shape != shape:
                    raise Error(f"loads have the shape {shape}, not {given.shape}")
                loads = given.copy()
                steps.set_loads(loads.reshape(-1))
        finally:
            steps.close()

    def plan(self, overrides: Overrides | None = None, **parameters: Any) -> dict[str, Any]:
        """What will be modelled, what is left out and why, what it costs."""
        words = ["plan", self.path, "--format", "json", *self._set(overrides, parameters)]
        found: dict[str, Any] = json.loads(command(words)[1])
        return found

    def moduli(
        self,
        overrides: Overrides | None = None,
        *,
        density: float | None = None,
        **parameters: Any,
    ) -> dict[str, Any]:
        """The elasticity tensor of the discrete body and moduli, in Pa; with a density wave speeds."""
        words = ["moduli", self.path, "--format", "json", *self._set(overrides, parameters)]
        words += ["--density", repr(density)] if density is not None else []
        found: dict[str, Any] = json.loads(command(words)[1])
        return found

    def calibrate(
        self,
        targets: Mapping[str, float | str],
        vary: list[str] | str,
        overrides: Overrides | None = None,
        **parameters: Any,
    ) -> dict[str, float]:
        """Values of parameters for which the discrete body has these moduli, `{"E": 200e9, "nu": 0.3}`."""
        vary = [vary] if isinstance(vary, str) else list(vary)
        wanted = ",".join(f"{name}={value}" for name, value in targets.items())
        words = ["calibrate", self.path, "--target", wanted, "--vary", ",".join(vary)]
        words += ["--format", "json", *self._set(overrides, parameters)]
        found: dict[str, float] = json.loads(command(words)[1])["parameters"]
        return found

    def trade(
        self,
        overrides: Overrides | None = None,
        *,
        budget: float = 60.0,
        axes: list[str] | None = None,
        **parameters: Any,
    ) -> dict[str, Any]:
        """Error against time over the settings of the solver, and the cheapest that is accurate enough."""
        words = ["trade", self.path, "--format", "json", "--budget", repr(float(budget))]
        words += ["--axes", ",".join(axes)] if axes else []
        found: dict[str, Any] = json.loads(command([*words, *self._set(overrides, parameters)])[1])
        return found

    def body(self, overrides: Overrides | None = None, **parameters: Any) -> Body:
        """Its body, for energies and derivatives at displacements of one's own."""
        return Body(_piola.Body(self.path, self._words(overrides, parameters)))

    def energy(
        self,
        displacement: ArrayLike | None = None,
        overrides: Overrides | None = None,
        **parameters: Any,
    ) -> Energy:
        """The energy at a displacement `(n, d)` in m, without one at rest. For many displacements of one body
        take `body()` once."""
        return self.body(overrides, **parameters).energy(displacement)

    def __repr__(self) -> str:
        return f"<Scene {self.path}>"


@dataclass
class Step:
    """A converged load step."""

    t: float
    iterations: int
    energy: float
    """In J."""
    displacement: Array
    """`(n, d)` in m."""
    residual: Array
    """`(n, d)` in N: dE/du minus the loads; the reaction where a component is prescribed."""
    loads: Array
    """`(n, d)` in N, at first 0: what a loop writes into it, or puts in its place, acts beside the scene's
    loads in the steps to come, which begin with it."""


class Body:
    """A scene's body: points, and energies at displacements. Rows are points in the scene's order."""

    def __init__(self, body: _piola.Body) -> None:
        self._body = body

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self._body.dimension

    @property
    def positions(self) -> Array:
        """At rest, `(n, d)` in m."""
        return self._body.positions.reshape(-1, self.dimension)

    @property
    def volumes(self) -> Array:
        """`(n,)` in m^d."""
        return self._body.volumes

    @property
    def interactions(self) -> dict[str, int]:
        """How many bonds, triangles and tetrahedra there are."""
        return dict(zip(("bonds", "triangles", "tetrahedra"), self._body.interactions, strict=True))

    def energy(self, displacement: ArrayLike | None = None) -> Energy:
        """The energy at a displacement `(n, d)` in m; without one at rest."""
        shape = (len(self.volumes), self.dimension)
        u = np.zeros(shape) if displacement is None else np.asarray(displacement, dtype=np.float64)
        if u.shape not in (shape, (shape[0] * shape[1],)):
            raise Error(f"displacements have the shape {shape}, not {u.shape}")
        return Energy(self._body, np.ascontiguousarray(u).reshape(-1), shape)


class Energy:
    """An energy at a displacement, and its derivatives."""

    def __init__(self, body: _piola.Body, u: Array, shape: tuple[int, int]) -> None:
        self._body, self._u, self._shape = body, u, shape
        parts, gradient = body.evaluate(u)
        self.parts: dict[str, float] = dict(parts)
        """In J, by kind of interaction."""
        self.gradient: Array = gradient.reshape(shape)
        """dE/du, `(n, d)` in N."""

    @property
    def value(self) -> float:
        """The whole in J."""
        return sum(self.parts.values())

    def __float__(self) -> float:
        return self.value

    @property
    def forces(self) -> Array:
        """What acts on the points, `(n, d)` in N: minus the gradient."""
        return -self.gradient

    def tangent(self) -> Any:
        """d2E/du2 in N/m as a SciPy CSR matrix, with d rows for each point."""
        from scipy.sparse import csr_matrix

        values, columns, starts = self._body.tangent(self._u)
        return csr_matrix((values, columns, starts), shape=(self._u.size, self._u.size))

    def product(self, vectors: ArrayLike) -> Array:
        """d2E/du2 times a vector `(n, d)` or vectors `(k, n, d)` in m, without a matrix; in N."""
        p = np.asarray(vectors, dtype=np.float64)
        if p.size % self._u.size != 0 or p.size == 0:
            raise Error(f"vectors have the shape {self._shape}, or several of them, not {p.shape}")
        return self._body.products(self._u, np.ascontiguousarray(p).reshape(-1)).reshape(p.shape)

    def operator(self) -> Any:
        """The same as a SciPy LinearOperator."""
        from scipy.sparse.linalg import LinearOperator

        n = self._u.size

        def columns(vectors: Array) -> Array:
            return self.product(np.ascontiguousarray(vectors.T)).reshape(-1, n).T

        return LinearOperator(
            (n, n), matvec=lambda p: self.product(p).reshape(-1), matmat=columns, dtype=np.float64,
            rmatvec=lambda p: self.product(p).reshape(-1),
        )

    def __repr__(self) -> str:
        return f"<Energy {self.value:g} J at {self._shape[0]} points>"


class Result:
    """What a run left in its folder."""

    def __init__(self, folder: str, kept: _Folder | None = None) -> None:
        self.folder = folder
        """Where the files are; gone with the result, unless `run` was given one."""
        self._kept = kept
        self._frames: list[Frame] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # Frames are read again where they are wanted.
        return {**self.__dict__, "_frames": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self._kept is not None:
            self.folder = os.path.join(self._kept.path, os.path.basename(self.folder))

    def _path(self, name: str) -> str:
        return os.path.join(self.folder, name)

    def table(self, name: str) -> dict[str, Array]:
        """A table of the run by its columns: `reactions`, `energy`, `probes`, `motion`, `fracture`, .."""
        with open(self._path(f"{name}.csv"), encoding="utf-8", newline="") as file:
            heads, *rows = csv.reader(file)
        def number(text: str) -> float:
            try:
                return float(text)
            except ValueError:
                return float("nan")

        columns = [[number(row[k]) for row in rows] for k in range(len(heads))]
        return {head: np.array(column) for head, column in zip(heads, columns, strict=True)}

    @property
    def summary(self) -> dict[str, Any]:
        """Everything about the run that fits a page."""
        with open(self._path("summary.json"), encoding="utf-8") as file:
            found: dict[str, Any] = json.load(file)
        return found

    @property
    def reactions(self) -> dict[str, Array]:
        """Reactions of the sets against t, in N."""
        return self.table("reactions")

    @property
    def probes(self) -> dict[str, Array]:
        """Displacements of the probes against t, in m."""
        return self.table("probes")

    @property
    def frames(self) -> list[Frame]:
        """The body at chosen times."""
        if self._frames is None:
            self._frames = read_frames(self.folder)
        return self._frames

    @property
    def displacement(self) -> Array:
        """At the end, `(n, d)` in m."""
        columns = self.table("displacement")
        names = [name for name in ("u", "v", "w") if name in columns]
        return np.stack([columns[name] for name in names], axis=1)

    def to_pyvista(self, frame: int = -1) -> Any:
        """A frame as a grid of PyVista, displaced: its cells where the body has a mesh."""
        import pyvista

        path = self.frames[frame].path
        cells = os.path.join(os.path.dirname(path), os.path.basename(path).replace("frame_", "cells_"))
        grid = pyvista.read(cells if os.path.exists(cells) else path)
        return grid.warp_by_vector("displacement")

    def picture(
        self,
        field: str | None = None,
        at: float | None = None,
        *,
        film: bool = False,
        force: str | None = None,
        against: str | None = None,
    ) -> bytes:
        """A PNG of the body at the frame next to `at`, at the end without it, coloured by a field of the frames or
        a component of one (`"stress_xy"`); with `film` of all frames, one after the other. With `force` a chart of
        the force on that set against its displacement, or that of `against`, another set or a probe."""
        words = ["picture", self.folder]
        for name, value in (("field", field), ("at", at), ("force", force), ("against", against)):
            words += [f"--{name}", str(value)] if value is not None else []
        words += ["--film"] if film else []
        with tempfile.TemporaryDirectory(prefix="piola-") as folder:
            path = os.path.join(folder, "picture.png")
            command([*words, "--out", path])
            with open(path, "rb") as file:
                return file.read()

    def _repr_png_(self) -> bytes:
        with open(self._path("picture.png"), "rb") as file:
            return file.read()

    def __repr__(self) -> str:
        return f"<Result {self.summary['exit_reason']}, {self.folder}>"


class _bar:
    """Whoever is told how far a run is."""

    def __init__(self, progress: bool | Callable[[float], object] | None) -> None:
        self._wanted = progress
        self._bar: Any = None

    def __enter__(self) -> Callable[[float], object] | None:
        if callable(self._wanted):
            return self._wanted
        if self._wanted is False:
            return None
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return None
        # Without a word there is a bar only where someone looks on.
        hidden = None if self._wanted is None else False
        self._bar = tqdm(total=1.0, disable=hidden, bar_format="{l_bar}{bar}| {elapsed}<{remaining}")
        return self._tell

    def _tell(self, part: float) -> None:
        self._bar.update(part - self._bar.n)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

