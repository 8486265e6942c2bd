"""A scene for many values of some of its keys."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _toml
from ._errors import Error, command
from ._scene import Scene


class Sweep:
    """The runs of a study, in the order of their values: those of the last key change fastest."""

    def __init__(self, found: Mapping[str, Any]) -> None:
        self.rows: list[dict[str, Any]] = found["rows"]
        """Of each run `values`, `state` and, where it reached its end, `found`."""
        self.units: dict[str, str] = found["units"]
        """Units of what was found."""
        self.varied: dict[str, list[str]] = {one["key"]: one["values"] for one in found["varied"]}
        """Keys and their values."""
        self.seconds: float = found["seconds"]
        """Wall time of all."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column: what was found, NaN where a run did not reach its end; or the values of a key."""
        if name in self.varied:
            texts = [row["values"][name] for row in self.rows]
            try:
                return np.array([float(text) for text in texts])
            except ValueError:
                return np.array(texts)
        if name not in self.units:
            raise KeyError(f"{name!r}: there are {', '.join(self.keys())}")
        column = [row.get("found", {}).get(name) for row in self.rows]
        return np.array([np.nan if one is None else one for one in column])

    def keys(self) -> list[str]:
        """Names of the columns."""
        return [*self.varied, *self.units]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self.rows)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """All columns, as `pandas.DataFrame` takes them."""
        return {name: self[name] for name in self.keys()}

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return f"<Sweep of {', '.join(self.varied)}: {len(self.rows)} runs>"


def sweep(
    scene: Scene | str | os.PathLike[str] | Mapping[str, Any],
    vary: Mapping[str, Iterable[Any]] | None = None,
    *,
    threads: int | None = None,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    overrides: Mapping[str, Any] | None = None,
    **parameters: Iterable[Any],
) -> Sweep:
    """Solves a scene for every combination of values, side by side.

    `vary` has keys with their values, `{"body.spacing": [0.1, 0.05]}`; parameters of [material] are given by
    their names, `C2=np.linspace(0, 200, 10)`. Runs that do not reach their end are rows that say so.
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    if not vary and not parameters:
        raise Error("nothing is varied: give keys with their values, or parameters")
    named = {f"material.parameters.{name}": values for name, values in parameters.items()}
    words = ["sweep", scene.path, "--format", "json", *scene._set(overrides, {})]
    for key, values in {**(vary or {}), **named}.items():
        if isinstance(values, str):
            # As the command line has it: FIRST:LAST:COUNT, or values with commas.
            texts = values
        else:
            texts = ",".join(one if isinstance(one, str) else _toml.value(one) for one in values)
        words += ["--vary", f"{key}={texts}"]
    words += ["--threads", str(threads)] if threads else []
    words += ["--out", os.fspath(out)] if out is not None else []
    words += ["--force"] if force else []
    # Runs that do not converge, or cannot start, are rows; what is wrong with all of them has no data.
    return Sweep(json.loads(command(words, accepted=(0, 2, 3))[1]))
