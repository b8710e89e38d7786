"""The notebooks: run all, which keeps their outputs in them (``python docs/notebook_pages.py``); a page of each."""

from __future__ import annotations

import base64
import re
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

import nbformat

FOLDER = Path(__file__).resolve().parent / "notebooks"
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def executed(name: str) -> Any:
    """Return a notebook with the outputs of a run in an empty folder; nbclient's error says which cell failed.

    Of the arm in a frame, which has its libraries with it, only the name is kept; :func:`page` makes it again.
    """
    from nbclient import NotebookClient

    notebook = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
    for cell in notebook.cells:
        cell.metadata.clear()  # when it ran
        for data in (output.get("data", {}) for output in cell.get("outputs", [])):
            if "text/html" in data:
                del data["text/html" if "<iframe" in data["text/html"] else "text/plain"]
    notebook.metadata.pop("widgets", None)
    return notebook


def page(name: str) -> tuple[str, dict[str, bytes]]:
    """Return the page of a notebook in markdown, and its pictures by file name."""
    lines: list[str] = []
    pictures: dict[str, bytes] = {}
    before: list[str] = []
    for cell in nbformat.read(FOLDER / f"{name}.ipynb", 4).cells:
        if cell.cell_type == "markdown":
            lines += [cell.source, ""]
            continue
        lines += ["```python", cell.source, "```", ""]
        before.append(cell.source)
        for output in cell.outputs:
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}_{len(pictures) + 1}.png"
                pictures[file] = base64.b64decode(data["image/png"])
                lines += [f"![{cell.source.splitlines()[-1]}]({file})", ""]
            elif "text/html" in data:
                lines += [f'<div class="output">{_one_line(data["text/html"])}</div>', ""]
            elif data.get("text/plain", "").startswith("<the arm of"):
                lines += [f'<div class="output">{_frame(before)}</div>', ""]
            else:
                text = output.get("text") or data.get("text/plain", "")
                lines += ["```text", text.rstrip(), "```", ""]
    return "\n".join(lines), pictures


def _frame(cells: list[str]) -> str:
    """Return what a notebook shows of the last of some cells, after those before have run in an empty folder."""
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(None):
        exec("\n".join(cells[:-1]), names)
        return eval(cells[-1], names)._repr_html_()


def _one_line(html: str) -> str:
    """Return HTML that Markdown leaves as it is, and tables that the pages draw as their own."""
    html = re.sub(r' (border|class)="[^"]*"', "", html)
    return "".join(line.strip() for line in html.splitlines())


if __name__ == "__main__":
    for chosen in sys.argv[1:] or NOTEBOOKS:
        nbformat.write(executed(chosen), FOLDER / f"{chosen}.ipynb")
