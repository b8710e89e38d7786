"""The pages of the documentation: their blocks of code, and the module of their versions."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
RUN_TOO = (
    "runs native modes identification world motions systems observers laws sweeps learning reference/units"
).split()
PAGES = [*TUTORIALS, *(ROOT / "docs" / f"{name}.md" for name in RUN_TOO)]
TOOLS = ROOT / "docs" / "importers.md"
"""Each section of it is about a tool, and runs by itself."""
BLOCK = re.compile(r"^```(?P<kind>\w+)(?P<options>[^\n]*)\n(?P<body>.*?)^```", re.DOTALL | re.MULTILINE)
SKIP = "<!-- not run -->\n"  # before a block that the test leaves out


def read_blocks(path, section=""):
    text = path.read_text(encoding="utf-8")
    if section:
        text = re.split(r"^## ", text.partition(f"\n## {section}\n")[2], maxsplit=1, flags=re.MULTILINE)[0]
    blocks, end = [], None
    for match in BLOCK.finditer(text):
        follows = end is not None and not text[end : match.start()].strip()
        skipped = text[: match.start()].endswith(SKIP)
        blocks.append((match["kind"], match["options"], match["body"], follows, skipped))
        end = match.end()
    return blocks


def environment():
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "TERM": "dumb"}


def run_process(kind, body, cwd=None, **further):
    program = [sys.executable, "-c"] if kind == "python" else ["bash", "-c"]
    return subprocess.run(
        [*program, body], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False, cwd=cwd,
        env=environment() | further,
    )  # fmt: skip


def readme_blocks():
    """Return kind, text and expected output, or None, of the blocks of the README that can be run."""
    blocks = read_blocks(README)
    runnable = []
    for (kind, _, body, _, _), after in zip(blocks, [*blocks[1:], None], strict=True):
        if kind in ("python", "sh"):
            runnable.append((kind, body, after[2] if after and after[0] == "text" and after[3] else None))
    return runnable


DOCS = Path(__file__).resolve().parents[2] / "docs"


def loaded():
    sys.path.insert(0, str(DOCS))
    try:
        return importlib.import_module("versions")
    finally:
        sys.path.remove(str(DOCS))
