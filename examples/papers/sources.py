"""Numbers of others: what a paper prints, and what independent programs found."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
REFERENCES = HERE.parents[1] / "tests" / "reference"


@dataclass(frozen=True)
class Printed:
    """A number of a paper, in the unit that its line names."""

    line: str
    x: float
    """Where it stands on the axis; NaN for numbers without one."""
    y: float
    reading: float
    """Half of its last digit, or what could be read off a figure."""


def printed(paper: str, figure: str) -> list[Printed]:
    """The rows of a figure or table in `published.csv` of the paper, in their order."""
    with (HERE / paper / "published.csv").open(encoding="utf-8", newline="") as file:
        return [
            Printed(row["line"], float(row["x"] or "nan"), float(row["y"]), float(row["reading"]))
            for row in csv.DictReader(file)
            if row["figure"] == figure
        ]


def reference(name: str) -> Any:
    """A file of tests/reference: its conventions and tolerances stand in it."""
    return json.loads((REFERENCES / f"{name}.json").read_text(encoding="utf-8"))
