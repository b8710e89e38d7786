"""The code of the README and of the documentation, run as a reader would.

Of the README each block runs by itself, in a fresh folder and process; of the other pages the blocks run in order, in
one folder, the ``python`` blocks in the namespace of those before. A ``sh`` block runs whole in bash, unless all its
commands are those of vdfmu, which need no Python started for each. A block with a title is written to that file. A
``text`` block right after a ``python`` or ``sh`` block is its output; a line ``...`` in it matches any lines.
"""

import contextlib
import io
import platform
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.docs.pages import PAGES, ROOT, TOOLS, environment, read_blocks, readme_blocks, run_process
from tests.warm import command

VARIES = re.compile(r"^│ (Wall time|Real-time factor) .*$", re.MULTILINE)
INSTALLS = re.compile(r"^make |pip install", re.MULTILINE)  # what is done in a clone


def run_python(body, namespace):
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream):
        exec(compile(body, "<tutorial>", "exec"), namespace)
    return stream.getvalue()


def plain_commands(body):
    lines = [line for line in body.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
    plain = all(re.fullmatch(r"""vdfmu( +([\w.,=:/@\[\]-]|'[^']*'|"[^"$`]*")+)*( *|  +#.*)""", line) for line in lines)
    return [shlex.split(line, comments=True)[1:] for line in lines] if plain else []


def run_shell(body, fails=False):
    """Run a block of commands, which all succeed unless they show how something fails."""
    if __name__ != "__main__" and (plain := plain_commands(body)):  # a section of a tool has too few of them
        done = [command(*words, env=environment(), merged=True) for words in plain]
    else:
        done = [run_process("sh", body if fails else f"set -e\n{body}")]
    said = "".join(process.stdout for process in done)
    failed = [process.returncode for process in (done[-1:] if fails else done) if process.returncode]
    assert not failed or (fails and failed[0] in (1, 2)), said
    assert "Traceback" not in said, said
    return said


def same(shown, output):
    """Compare line by line, without trailing blanks and times of the clock; ``...`` matches any lines."""
    shown, output = VARIES.sub("", shown), VARIES.sub("", output)
    parts = [re.escape("\n".join(line.rstrip() for line in part.strip("\n").splitlines())) for part in
             re.split(r"^\s*\.\.\.$", shown, flags=re.MULTILINE)]  # fmt: skip
    pattern = r"(?:.*?)".join(parts)
    got = "\n".join(line.rstrip() for line in output.strip("\n").splitlines())
    return re.fullmatch(pattern, got, re.DOTALL) is not None


def run_page(path, section=""):
    namespace = {"__name__": "__main__"}
    output, checked = None, 0
    blocks = read_blocks(path, section)
    for (kind, options, body, follows, skipped), after in zip(blocks, [*blocks[1:], None], strict=True):
        title = re.search(r'title="([^"]+)"', options)
        if skipped:
            output = None
        elif title:
            Path(title[1]).write_text(body, encoding="utf-8")
            output = None
        elif kind == "python":
            output = run_python(body, namespace)
            checked += 1
        elif kind == "sh":
            output = run_shell(body, fails=after is not None and "error:" in after[2])
            checked += 1
        elif kind == "text" and follows and output is not None:
            assert same(body, output), f"{path.name} shows\n{body}\nbut the code gives\n{output}"
            checked += 1
    return checked


@pytest.mark.heavy
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tutorial_runs_and_shows_its_output(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # what the page imports from its own files
    with np.printoptions():  # what a page sets is for that page
        assert run_page(page) >= 2  # blocks run or compared


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("kind", "body", "output"),
    # .ci/run runs the block of `make`, in a clean checkout, and tests/cli/test_wheel.py that of pip
    [pytest.param(*block, id=str(i)) for i, block in enumerate(readme_blocks()) if not INSTALLS.search(block[1])],
)
def test_block_of_the_readme_runs_by_itself_as_printed(tmp_path, kind, body, output):
    done = run_process(kind, f"set -e\n{body}" if kind == "sh" else body, tmp_path)
    assert done.returncode == 0, done.stdout
    assert output is None or same(output, done.stdout), f"expected\n{output}\ngot\n{done.stdout}"


def test_the_start_page_installs_as_the_readme():
    commands = [re.sub(r" +#.*", "", body) for kind, body, _ in readme_blocks() if INSTALLS.search(body)]
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert commands and all(f"```sh\n{body}```" in page for body in commands)


@pytest.mark.heavy
@pytest.mark.parametrize("tool", ["FMPy", "ecos", "libcosim", "Modelica tools", "Simulink"])
def test_section_of_a_tool_runs_and_shows_its_output(tool, tmp_path):
    """In a separate process: a tool that crashes must not take this one with it."""
    here = (platform.system(), platform.machine())
    if tool in ("ecos", "libcosim") and here not in {("Linux", "x86_64"), ("Windows", "AMD64")}:
        pytest.skip(f"{tool} has no binaries for {' '.join(here)}")
    done = subprocess.run(
        [sys.executable, "-m", "tests.docs.test_tutorials", str(TOOLS), tool], cwd=tmp_path, text=True, check=False,
        timeout=300, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert int(done.stdout.splitlines()[-1]) >= 3  # blocks run or compared


def test_outputs_compare_with_gaps():
    assert same("a\n...\nd\n", "a\nb\nc\nd\n")
    assert not same("a\n...\nd\n", "a\nb\nc\n")
    assert not same("a\n", "b\n")


if __name__ == "__main__":  # run a page in the current folder, see test_section_of_a_tool_runs_and_shows_its_output
    print(run_page(Path(sys.argv[1]), *sys.argv[2:]))
