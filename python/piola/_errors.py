"""What is wrong, and what should be known."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from . import _piola
from ._piola import Error as Error


def _findings(self: Error) -> list[dict[str, Any]]:
    """Part by part what is wrong: `code`, `message`, `file`, `line`, `column`, `start`, `end`, `helps`."""
    found: list[dict[str, Any]] = json.loads(self.args[1]) if len(self.args) > 1 else []
    return found


Error.findings = property(_findings)  # type: ignore[assignment]
Error.__str__ = lambda self: str(self.args[0]) if self.args else ""  # type: ignore[method-assign]


# What a run left before it failed, where it did.
Error.result = None


class NotConverged(Error):
    """The solver did not reach the end of a scene; `result` has what converged, where there is any."""


class PiolaWarning(UserWarning):
    """What the user of a scene should know; the work goes on."""


def command(
    words: Sequence[str],
    progress: Callable[[float], object] | None = None,
    accepted: Sequence[int] = (0,),
) -> tuple[int, str]:
    """Executes a command of the program: exit code and data; what went wrong is an exception."""
    code, data, messages, findings = _piola.command([str(word) for word in words], progress)
    found = json.loads(findings)
    for one in found:
        if one["severity"] == "warning":
            warnings.warn(one["message"], PiolaWarning, stacklevel=3)
    if code in accepted and (data or code == 0):
        return code, data
    failed = [one for one in found if one["severity"] == "error"]
    kind = NotConverged if code == 3 else Error
    message = messages.strip() or data.strip() or f"the command ended with exit code {code}"
    raise kind(message, json.dumps(failed))
