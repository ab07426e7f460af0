"""The notebooks of the documentation run from begin to end, as they stand there."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest

from eppanalysis.report.notebook import execute

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parent.parent / "docs" / "tutorials"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_tutorials():
    assert len(NOTEBOOKS) >= 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_tutorial_runs(path):
    notebook = nbformat.read(path, 4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are made when the documentation is built"
    done = execute(notebook, path.name)
    outputs = [out for cell in done.cells for out in cell.get("outputs", ())]
    assert any("image/png" in out.get("data", {}) for out in outputs)
    assert not any(out.get("name") == "stderr" for out in outputs), [
        o.get("text") for o in outputs if o.get("name") == "stderr"
    ]
