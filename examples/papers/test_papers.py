"""Short versions of all studies find what is recorded, and the page is that of the record."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import page
import program
from study import Study

STUDIES = program.load()
# Rounding differs between machines; digits of the page do not. A row that is nearer to rounding says so itself.
SAME = 1e-6


def record(study: Study) -> dict[str, Any]:
    path = program.RECORDED / study.paper / f"{study.name}.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("study", [one for one in STUDIES if one.body], ids=lambda one: one.key)
def test_short_version_finds_what_is_recorded(study: Study, tmp_path: Path) -> None:
    recorded = {row["what"]: row for row in record(study)["rows"] if row.get("cheap", True)}
    found = program.run(study, tmp_path, full=False)
    rows: Any = found["rows"]
    assert {row["what"] for row in rows} == set(recorded), "a row is in one version alone"
    for row in rows:
        expected = recorded[row["what"]]
        if row.get("timed"):
            continue
        assert row["verdict"] == expected["verdict"], row
        if row["kind"] == "number":
            scale = max(abs(row["ours"]), abs(row.get("published") or 0.0))
            within = max(SAME * scale, row.get("rounding", 0.0))
            assert abs(row["ours"] - expected["ours"]) <= within, (row, expected)


def test_page_is_that_of_the_record() -> None:
    written = (program.ROOT / "docs" / "measured" / "papers.md").read_text(encoding="utf-8")
    assert page.render(STUDIES, program.RECORDED) == written, "write it anew: python examples/papers --page"


def test_every_study_has_a_verdict() -> None:
    for study in STUDIES:
        assert study.body is None or record(study)["rows"], study.key
