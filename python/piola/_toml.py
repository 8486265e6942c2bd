"""Scenes and overrides as TOML."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._errors import Error
from ._law import Law

_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}


def value(given: Any) -> str:
    """A value as TOML has it."""
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given.item()
    if isinstance(given, (bool, np.bool_)):
        return "true" if given else "false"
    if isinstance(given, (int, np.integer)):
        return str(int(given))
    if isinstance(given, (float, np.floating)):
        return repr(float(given))
    if isinstance(given, str):
        return '"' + "".join(_ESCAPES.get(c, c) for c in given) + '"'
    if isinstance(given, Mapping):
        return "{ " + ", ".join(f"{value(str(k))} = {value(v)}" for k, v in given.items()) + " }"
    if isinstance(given, (Sequence, np.ndarray)):
        return "[" + ", ".join(value(one) for one in given) + "]"
    raise Error(f"{given!r} is no value of a scene: numbers, texts, lists and dicts are")


def overrides(keys: Mapping[str, Any] | None, parameters: Mapping[str, Any]) -> list[str]:
    """`KEY=VALUE` as the program takes them; parameters are those of [material]."""
    named = {f"material.parameters.{name}": given for name, given in parameters.items()}
    return [f"{key}={value(given)}" for key, given in {**(keys or {}), **named}.items()]


def write_scene(scene: Mapping[str, Any], folder: str, base: str) -> str:
    """Writes a scene and the potentials that it has as values; the path of its file."""
    laws: list[str] = []

    def place(given: Any, key: str | None) -> Any:
        if key in ("potential", "mesh", "points", "numbers", "rule") and isinstance(given, str):
            if key == "potential" and "\n" in given:
                laws.append(given)
                name = f"law{len(laws)}.piola"
                with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
                    file.write(given)
                return name
            is_file = key in ("mesh", "points", "numbers") or given.endswith(".piola")
            return os.path.abspath(os.path.join(base, given)) if is_file else given
        if isinstance(given, Mapping):
            law = given.get("potential")
            if isinstance(law, Law):
                # A law brings its values; what the scene says beside it holds over them.
                own = {**law.given, **given.get("parameters", {})}
                given = {**given, "potential": law.text, "parameters": own}
            return {name: place(one, str(name)) for name, one in given.items()}
        if isinstance(given, (list, tuple)):
            return [place(one, key) for one in given]
        return given

    lines = [f"{value(str(name))} = {value(place(one, str(name)))}" for name, one in scene.items()]
    path = os.path.join(folder, "scene.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
    return path
