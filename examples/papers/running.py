"""Runs of a study: each once, with its time and memory, found again when a study goes on."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import piola

HERE = Path(__file__).parent
PROGRAM = hashlib.sha256(Path(piola._piola.__file__).read_bytes()).digest()


class Run:
    """What a study runs with: full or short, its scenes, and what is done already.

    Seconds and memory are those of the runs when they were done, so a study that is taken up again reports
    what it would have taken in one go.
    """

    def __init__(self, paper: str, name: str, out: Path, full: bool) -> None:
        self.full = full
        self._paper = HERE / paper
        self._out = out
        self._kept = out / "runs" / paper / name
        self.seconds = 0.0
        self.megabytes = 0.0

    def forget(self) -> None:
        """Computes all of it again."""
        shutil.rmtree(self._kept, ignore_errors=True)

    def beside(self, name: str) -> Run:
        """The runs of another study of the paper, which this one shares; itself by its own name."""
        return self if self._kept.name == name else Run(self._paper.name, name, self._out, self.full)

    def path(self, name: str) -> Path:
        """A file of the paper's folder."""
        return self._paper / name

    def scene(self, name: str, overrides: Mapping[str, Any] | None = None, **parameters: Any) -> piola.Scene:
        """A scene of the paper's folder, or of another with `../`."""
        return piola.Scene(self.path(name), overrides, **parameters)

    def solve(
        self,
        name: str,
        overrides: Mapping[str, Any] | None = None,
        *,
        threads: int | None = None,
        may_fail: bool = False,
        **parameters: Any,
    ) -> piola.Result:
        """Runs a scene, or opens what it left the last time.

        With `may_fail` a run that ends early or at something unstable is a result, too: `exit_reason` of its
        summary says how it ended.
        """
        words = [name, sorted((overrides or {}).items()), sorted(parameters.items())]
        scene = self.path(name)
        laws = [law.read_bytes() for law in sorted(scene.parent.glob("*.piola"))]
        key = self._key([*words, scene.read_bytes(), *laws])
        folder = self._kept / f"{Path(name).stem}-{key}"
        told = folder.with_suffix(".json")
        if not told.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.parent.mkdir(parents=True, exist_ok=True)
            since = time.perf_counter()
            try:
                self.scene(name, overrides, **parameters).run(folder, threads=threads, progress=False)
            except piola.Error as error:
                if not (may_fail and getattr(error, "result", None) is not None):
                    raise
            self._tell(told, time.perf_counter() - since, None)
        self._add(json.loads(told.read_text()))
        return piola.Result(str(folder))

    def once(self, what: str, compute: Callable[[], Any], *words: Any) -> Any:
        """A value that takes long and is no run of a scene: numbers, texts, lists and dicts of such.

        `words` are all that it depends on.
        """
        told = self._kept / f"{what}-{self._key([what, *words])}.json"
        if not told.exists():
            told.parent.mkdir(parents=True, exist_ok=True)
            since = time.perf_counter()
            value = compute()
            self._tell(told, time.perf_counter() - since, value)
        found = json.loads(told.read_text())
        self._add(found)
        return found["value"]

    def _key(self, words: list[Any]) -> str:
        """Changes with the program, with every law of the paper, and with the words; not with the studies, so a
        study that computes something else than before is run with `--again`."""
        text = hashlib.sha256(PROGRAM)
        for path in sorted(self._paper.rglob("*.piola")):
            text.update(path.read_bytes())
        text.update(repr(words).encode())
        return text.hexdigest()[:12]

    def _add(self, told: Mapping[str, Any]) -> None:
        self.seconds += told["seconds"]
        self.megabytes = max(self.megabytes, told["megabytes"])

    @staticmethod
    def _tell(told: Path, seconds: float, value: Any) -> None:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        written = told.with_suffix(".part")
        written.write_text(json.dumps({"seconds": seconds, "megabytes": peak, "value": value}))
        os.replace(written, told)
