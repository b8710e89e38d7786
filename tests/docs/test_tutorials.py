"""The code of the README and of the tutorials, run as a reader would: in order, in an empty folder.

A ``python`` block runs in the namespace of the blocks before it. A ``toml`` block with a title is written to
that file. A ``sh`` block runs its lines that start with ``vdfmu``. A ``text`` block right after a ``python`` or
``sh`` block is its output; a line ``...`` in it stands for any lines.
"""

import contextlib
import io
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
GUIDES = sorted((ROOT / "docs" / "guides").glob("*.md"))
BLOCK = re.compile(r"^```(?P<kind>\w+)(?P<options>[^\n]*)\n(?P<body>.*?)^```", re.DOTALL | re.MULTILINE)
SKIP = "<!-- not run -->\n"  # before a block that the test leaves out


def read_blocks(path):
    text = path.read_text(encoding="utf-8")
    blocks, end = [], None
    for match in BLOCK.finditer(text):
        follows = end is not None and not text[end : match.start()].strip()
        skipped = text[: match.start()].endswith(SKIP)
        blocks.append((match["kind"], match["options"], match["body"], follows, skipped))
        end = match.end()
    return blocks


def run_python(body, namespace):
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream):
        exec(compile(body, "<tutorial>", "exec"), namespace)
    return stream.getvalue()


def run_shell(body):
    output = ""
    for line in body.replace("\\\n", " ").splitlines():
        if line.startswith("vdfmu "):
            command = line.replace("vdfmu", f'"{sys.executable}" -m vdfmu.cli', 1)
            done = subprocess.run(
                command, shell=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                env={**os.environ, "COLUMNS": "100", "TERM": "dumb"},
            )  # fmt: skip
            assert done.returncode in (0, 1, 2) and "Traceback" not in done.stdout, done.stdout
            output += done.stdout
    return output


def same(shown, output):
    """Compare line by line, without trailing blanks; ``...`` stands for any lines."""
    parts = [re.escape("\n".join(line.rstrip() for line in part.strip("\n").splitlines())) for part in
             re.split(r"^\s*\.\.\.$", shown, flags=re.MULTILINE)]  # fmt: skip
    pattern = r"(?:.*?)".join(parts)
    got = "\n".join(line.rstrip() for line in output.strip("\n").splitlines())
    return re.fullmatch(pattern, got, re.DOTALL) is not None


def run_page(path):
    namespace = {"__name__": "__main__"}
    output, checked = None, 0
    for kind, options, body, follows, skipped in read_blocks(path):
        if skipped:
            output = None
        elif kind == "python":
            output = run_python(body, namespace)
            checked += 1
        elif kind == "sh":
            output = run_shell(body)
            checked += 1
        elif kind == "toml":
            title = re.search(r'title="([^"]+)"', options)
            if title:
                Path(title[1]).write_text(body, encoding="utf-8")
            output = None
        elif kind == "text" and follows and output is not None:
            assert same(body, output), f"{path.name} shows\n{body}\nbut the code gives\n{output}"
            checked += 1
    return checked


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tutorial_runs_and_shows_its_output(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_page(page) >= 3


@pytest.mark.slow
def test_readme_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_page(ROOT / "README.md") >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in GUIDES if page.stem != "omsimulator"], ids=lambda page: page.stem
)
def test_guide_runs_and_shows_its_output(page, tmp_path):
    """In a process of its own: a tool that crashes must not take this one with it."""
    here = (platform.system(), platform.machine())
    if page.stem in ("ecos", "libcosim") and here not in {("Linux", "x86_64"), ("Windows", "AMD64")}:
        pytest.skip(f"{page.stem} has no binaries for {' '.join(here)}")
    done = subprocess.run(
        [sys.executable, __file__, str(page)], cwd=tmp_path, text=True, check=False, timeout=300,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert int(done.stdout.splitlines()[-1]) >= 3  # blocks run or compared


def test_there_is_a_guide_for_each_tool():
    assert [page.stem for page in GUIDES] == [
        "ecos",
        "fmpy",
        "libcosim",
        "modelica",
        "omsimulator",
        "simulink",
    ]


def test_there_are_five_tutorials():
    assert [page.stem for page in PAGES] == ["dynamics", "fmpy", "native", "own_robot", "sweep"]


def test_outputs_compare_with_gaps():
    assert same("a\n...\nd\n", "a\nb\nc\nd\n")
    assert not same("a\n...\nd\n", "a\nb\nc\n")
    assert not same("a\n", "b\n")


if __name__ == "__main__":  # run a page in the current folder, see test_guide_runs_and_shows_its_output
    print(run_page(Path(sys.argv[1])))
