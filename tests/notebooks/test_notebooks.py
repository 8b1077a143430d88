"""The notebooks of the documentation: short, stored without outputs, and they run."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import torquebench

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_short_and_without_outputs(path):
    """At most 10 cells of at most 6 lines; nothing of a machine is stored in it."""
    cells = nbformat.read(path, as_version=4).cells
    assert len(cells) <= 10
    assert max(len(cell.source.splitlines()) for cell in cells) <= 6
    for cell in cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    """Every cell, in order, in an empty folder; runs and sweeps are shown as tables, figures as pictures."""
    monkeypatch.setenv("PYTHONPATH", str(Path(torquebench.__file__).parents[1]))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("<table" in data.get("text/html", "") for data in outputs) >= 3
    assert sum("image/png" in data for data in outputs) >= 3
    assert (tmp_path / "page.html").is_file()


def test_the_documentation_has_notebooks():
    """The folder that is looked through is the right one."""
    assert [path.stem for path in NOTEBOOKS] == ["first-run"]
