"""docs/measured/papers.md, from what is recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from study import PAPERS, Study, counted

HEAD = """# Figures and tables of the five papers

Every figure and table of the [five papers](../../potentials/REFERENCES.md) that piola was made from, computed again
or refuted, by the program [examples/papers](../../examples/papers/README.md), which writes this page from what it
found. A row *agrees* if the numbers differ by no more than 1 %, or than what the paper's digits or its figure leave
open; *after a correction* if something that the paper says had to be changed first. If they differ by more, the row is
*refuted* where an independent program or a closed form has our number within 1 % with the same settings: those of the
paper, and where it leaves settings open, those that the notes name. Else it *differs*. Rows without a number in the
paper are *not comparable*. Times are of two virtual cores of a server, some of them beside other work.
"""


def number(value: float | None, unit: str = "") -> str:
    """Five digits."""
    if value is None:
        return "-"
    return f"{value:.5g} {unit}".strip()


def both(row: dict[str, Any]) -> tuple[str, str]:
    """What the paper has, and what we have."""
    if row["kind"] == "claim":
        return row["published"], row["ours"]
    unit = row.get("unit", "")
    return number(row.get("published"), unit), number(row["ours"], unit)


def rows(given: Any) -> list[str]:
    """Rows of a study as text, for the terminal."""
    lines = []
    for row in given:
        published, ours = both(row)
        lines.append(f"{row['verdict']:<26} {row['what']}: paper {published}, here {ours}")
    return lines


def render(studies: list[Study], recorded: Path) -> str:
    """The page. Studies without a record are said to be missing."""
    told = {study.key: _record(study, recorded) for study in studies}
    parts = [HEAD, _summary(studies, told)]
    for paper in PAPERS:
        parts.append(f"## {paper}\n")
        for study in (one for one in studies if one.paper == paper):
            parts.append(_study(study, told[study.key]))
    return "\n".join(parts)


def _record(study: Study, recorded: Path) -> dict[str, Any] | None:
    path = recorded / study.paper / f"{study.name}.json"
    if not path.exists():
        return None
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _summary(studies: list[Study], told: dict[str, dict[str, Any] | None]) -> str:
    lines = ["| paper | " + " | ".join(counted([])) + " | time, min |", "|---" * 7 + "|"]
    for paper in PAPERS:
        done = [record for study in studies if study.paper == paper and (record := told[study.key])]
        verdicts = counted(row["verdict"] for record in done for row in record["rows"])
        minutes = sum(record["seconds"] for record in done) / 60.0
        cells = [f"[{paper}](#{paper})", *map(str, verdicts.values()), f"{minutes:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _study(study: Study, record: dict[str, Any] | None) -> str:
    if study.body is None:
        verb = "lists" if study.label.startswith("Table") else "draws"
        return f"**{study.label}** {verb} {study.draws}: nothing is computed.\n"
    lines = [f"### {study.paper}, {study.label}: {study.title}\n"]
    if record is None:
        return "\n".join([*lines, "Not recorded.\n"])
    if record["pictured"]:
        lines.append(f"![{study.paper}, {study.label}: {study.title}](papers/{study.paper}/{study.name}.png)\n")
    repeated = _repeated(record["rows"])
    lines += ["| quantity | paper | here | difference | verdict |", "|---|---|---|---|---|"]
    lines += [_row(row, repeated) for row in record["rows"]]
    lines.append("")
    lines += [f"({k}) {reason}.\n" for k, reason in enumerate(repeated, 1)]
    if record["notes"]:
        lines.append(record["notes"] + "\n")
    scope = "" if record["full"] else ", the short version"
    cost = f"{record['seconds']:.3g} s, {record['megabytes']} MB{scope}"
    lines.append(f"`python examples/papers --full {study.key}`: {cost}.\n")
    return "\n".join(lines)


def _reasons(row: dict[str, Any]) -> list[str]:
    """What was corrected, why numbers differ, and who else has them."""
    found = [row.get("correction", ""), row.get("why", "")]
    if row.get("independent") is not None or row.get("refuted"):
        value = number(row["independent"], row.get("unit", "")) + " by " if row.get("independent") is not None else ""
        found.append(value + row.get("source", ""))
    return [one for one in found if one]


def _repeated(given: list[dict[str, Any]]) -> list[str]:
    """Long reasons of several rows, which stand below the table once."""
    every = [reason for row in given for reason in _reasons(row) if len(reason) > 60]
    return [reason for reason in dict.fromkeys(every) if every.count(reason) > 1]


def _row(row: dict[str, Any], repeated: list[str]) -> str:
    published, ours = both(row)
    difference = ""
    if row["kind"] == "number" and row.get("published"):
        difference = f"{100.0 * (row['ours'] / row['published'] - 1.0):+.2g} %"
    if row.get("reading"):
        published += f" +- {row['reading']:.2g}"
    verdict = f"**{row['verdict']}**" if row["verdict"] == "differs" else row["verdict"]
    reasons = [f"({repeated.index(one) + 1})" if one in repeated else one for one in _reasons(row)]
    cells = [row["what"], published, ours, difference, verdict + (f": {'; '.join(reasons)}" if reasons else "")]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
