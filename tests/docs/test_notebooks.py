"""The notebooks of the documentation run, and print what they show."""

import importlib
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
NAMES = sorted(path.stem for path in (DOCS / "notebooks").glob("*.ipynb"))


def printed(notebook):
    return ["".join("".join(output.get("text", "")) for output in cell.get("outputs", [])) for cell in notebook.cells]


@pytest.mark.heavy
@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_and_prints_what_it_shows(monkeypatch, name):
    monkeypatch.syspath_prepend(DOCS)
    pages = importlib.import_module("notebook_pages")
    kept = pages.nbformat.read(DOCS / "notebooks" / f"{name}.ipynb", 4)
    notebook = pages.executed(name)
    assert printed(notebook) == printed(kept)
    assert any(printed(kept))
    text, pictures = pages.page(name)
    assert "<iframe" not in str(kept)  # its libraries are 0.3 MB; the page makes the arm again
    assert text.count("<iframe") == sum("animate(run)" in cell.source for cell in kept.cells)
    assert len(pictures) == text.count("![") >= 1
    for cell in kept.cells:
        assert cell.source in text
        assert cell.cell_type == "markdown" or cell.execution_count  # it was run before it was kept
