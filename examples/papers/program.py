"""Every figure and table of the five papers.

    python examples/papers --list                     what there is
    python examples/papers javili2020/fig08           one, its short version
    python examples/papers --full javili2020          all of a paper, in full
    python examples/papers --full                     everything; goes on where it was interrupted
    python examples/papers --page                     docs/measured/papers.md from what is recorded

Results are written to `out/papers`, or where `--out` says; with `--record` to docs/measured/papers, from which
the page is made.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Iterable
from pathlib import Path

import page
from drawing import draw
from running import Run
from study import PAPERS, STUDIES, Study, as_json, counted

ROOT = Path(__file__).resolve().parents[2]
RECORDED = ROOT / "docs" / "measured" / "papers"


def load(papers: Iterable[str] = PAPERS) -> list[Study]:
    """The studies of papers, in the order of these and of their figures and tables."""
    for paper in papers:
        importlib.import_module(f"{paper}.figures")
    return sorted(STUDIES, key=lambda study: (PAPERS.index(study.paper), study.name))


def run(study: Study, out: Path, full: bool, again: bool = False) -> dict[str, object]:
    """Computes one, and writes what it found as `NAME.json` and `NAME.png`."""
    assert study.body is not None
    runs = Run(study.paper, study.name, out, full)
    if again:
        runs.forget()
    since = time.perf_counter()
    found = study.body(runs)
    told: dict[str, object] = {
        "label": study.label,
        "title": study.title,
        "full": full,
        "seconds": round(max(runs.seconds, time.perf_counter() - since), 1),
        "megabytes": round(runs.megabytes),
        "rows": as_json(found),
        "notes": " ".join(found.notes.split()),
        "pictured": bool(found.panels),
    }
    folder = out / study.paper
    folder.mkdir(parents=True, exist_ok=True)
    draw(found, f"{study.paper}, {study.label}: {study.title}", folder / f"{study.name}.png")
    written = folder / f"{study.name}.json.part"
    written.write_text(json.dumps(told, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(written, folder / f"{study.name}.json")
    return told


def chosen(studies: list[Study], names: list[str]) -> list[Study]:
    """Those that are named by paper or by key; all without a name."""
    for name in names:
        if name not in {word for study in studies for word in (study.paper, study.key)}:
            sys.exit(f"there is no study `{name}`: --list shows them")
    return [study for study in studies if not names or {study.paper, study.key} & set(names)]


def main() -> int:
    words = argparse.ArgumentParser(prog="papers", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    words.add_argument("names", nargs="*", help="papers, or figures and tables of them")
    words.add_argument("--full", action="store_true", help="all sizes that the paper has, not the short version")
    words.add_argument("--again", action="store_true", help="studies that are done, too")
    words.add_argument("--list", action="store_true", help="what there is")
    words.add_argument("--record", action="store_true", help="write to docs/measured/papers, too")
    words.add_argument("--page", action="store_true", help="write docs/measured/papers.md from what is recorded")
    words.add_argument("--out", type=Path, default=Path("out/papers"), help="where results go (out/papers)")
    asked = words.parse_args()
    named = {name.split("/")[0] for name in asked.names} & set(PAPERS)
    studies = load(named or PAPERS)
    if asked.list:
        for study in chosen(studies, asked.names):
            print(f"{study.key:<28} {study.label:<10} {study.title or 'draws ' + study.draws}")
        return 0
    if asked.page:
        (ROOT / "docs" / "measured" / "papers.md").write_text(page.render(studies, RECORDED), encoding="utf-8")
        return 0
    wanted = [study for study in chosen(studies, asked.names) if study.body]
    out = asked.out / ("full" if asked.full else "short")
    failed = 0
    for study in wanted:
        told = out / study.paper / f"{study.name}.json"
        if len(wanted) > 1:
            # Each in a process of its own: its memory is its own, and the rest goes on if it fails.
            if asked.again or not told.exists():
                again = [word for word in sys.argv[1:] if word not in asked.names]
                failed += subprocess.run([sys.executable, str(Path(__file__).parent), *again, study.key]).returncode
        else:
            failed += alone(study, out, asked)
    if len(wanted) > 1:
        told = [out / study.paper / f"{study.name}.json" for study in wanted]
        rows = [row["verdict"] for path in told if path.exists() for row in json.loads(path.read_text())["rows"]]
        print("; ".join(f"{count} {verdict}" for verdict, count in counted(rows).items()))
    return min(failed, 1)


def alone(study: Study, out: Path, asked: argparse.Namespace) -> int:
    """One study, with its rows as text."""
    try:
        told = run(study, out, asked.full, asked.again)
    except Exception:
        print(f"{study.key}: failed\n{traceback.format_exc()}", file=sys.stderr)
        return 1
    if asked.record:
        folder = RECORDED / study.paper
        folder.mkdir(parents=True, exist_ok=True)
        for ending in ("json", "png"):
            made = out / study.paper / f"{study.name}.{ending}"
            if made.exists():
                (folder / made.name).write_bytes(made.read_bytes())
    print(f"{study.key}: {study.title} ({told['seconds']} s, {told['megabytes']} MB)")
    for line in page.rows(told["rows"]):
        print(f"  {line}")
    return 0
