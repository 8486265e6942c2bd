"""What pages show is run: the blocks of docs/python.md one after the other, and the notebook."""

import os
import re

import nbformat
from nbclient import NotebookClient

ROOT = os.path.join(os.path.dirname(__file__), "..", "..")


def test_the_page_is_right(tmp_path, monkeypatch):
    with open(os.path.join(ROOT, "docs", "python.md"), encoding="utf-8") as file:
        page = file.read()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= 6
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_the_notebook_runs():
    notebook = nbformat.read(os.path.join(ROOT, "python", "examples", "first.ipynb"), as_version=4)
    NotebookClient(notebook, timeout=300).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert any("text/latex" in output.get("data", {}) for output in outputs)
