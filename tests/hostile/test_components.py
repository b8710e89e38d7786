"""Components that mean harm: what the checker keeps of them, and what it lets them take."""

import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from tests.cc import CC
from vdfmu.base.process import KEPT
from vdfmu.base.text import shown
from vdfmu.engine.fmu.messages import MessageBox, boxes, on_message
from vdfmu.engine.inspect import trial as check_run
from vdfmu.engine.inspect.inspection import inspect_file

XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Bad" guid="{bad}">
  <CoSimulation modelIdentifier="bad"/>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1"/></Outputs>
  <InitialUnknowns><Unknown index="1"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""
ESCAPE = "\\033[2J\\033]0;owned\\007"
FLOOD = 'for (int i = 0; i < 300000; i++) fputs("0123456789012345678901234567890123456789\\n", stderr);'
CODE = {
    "flood": f'{FLOOD} fputs("{ESCAPE}\\n", stderr); _exit(3);',
    "memory": "for (int i = 0; i < 64; i++) { char *p = malloc(1 << 28); if (!p) _exit(7); memset(p, 1, 1 << 28); }",
    "hang": "for (;;) sleep(1);",
}


@pytest.fixture
def unit(tmp_path):
    """Return a function that makes an FMU whose library runs code when it is loaded."""

    def make(code: str, xml: str = XML) -> Path:
        source = tmp_path / "bad.c"
        source.write_text(
            "#include <stdio.h>\n#include <stdlib.h>\n#include <string.h>\n#include <unistd.h>\n"
            f"__attribute__((constructor)) static void run(void) {{ {code} }}\n"
        )
        library = tmp_path / f"bad{fmpy.sharedLibraryExtension}"
        subprocess.run([*CC, "-shared", "-fPIC", "-o", library, source], check=True)
        path = tmp_path / "Bad.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", xml)
            archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
        return path

    return make


@pytest.mark.heavy
def test_memory_is_limited(unit, monkeypatch):
    """16 GiB are asked for in blocks of 256 MiB; the first that is refused ends the process."""
    monkeypatch.setenv("PYTHONMALLOC", "malloc")
    (problem,) = check_run.run_apart(unit(CODE["memory"])).problems
    assert "exit code 7" in problem


def test_a_unit_that_never_answers_is_ended_and_findings_that_it_wrote_are_bounded(unit, monkeypatch):
    monkeypatch.setattr(check_run, "SECONDS", 3.0)
    (problem,) = check_run.run_apart(unit(CODE["hang"])).problems
    assert problem == "load in the test of a run of 10 steps did not end within 3 s"
    # The process is the unit's: it may write any findings.
    monkeypatch.setattr(check_run, "_ANSWER_LIMIT", 10)

    def answer(*arguments):
        Path(arguments[-3], "findings.json").write_text("[" * 1000)
        return 0, ""

    monkeypatch.setattr(check_run, "_contained", answer)
    (problem,) = check_run.run_apart(unit("")).problems
    assert problem.endswith("cannot be read: they have more than 10 bytes")


def test_what_the_description_forbids_is_not_run(unit, tmp_path):
    """A description against the schema; and a second instance in a process that may have one only."""
    proof = tmp_path / "ran"
    path = unit(f'fclose(fopen("{proof}", "w"));', XML.replace('causality="output"', 'causality="outputs"'))
    report = inspect_file(path)
    assert report.problems and not report.ran
    assert not proof.exists()


@pytest.mark.heavy
def test_what_a_component_writes_is_bounded_and_escapes_are_shown_and_not_executed(unit, tmp_path):
    hostile = unit(CODE["flood"]).rename(tmp_path / "a\x1b[2Jb.fmu")
    done = subprocess.run([sys.executable, "-m", "vdfmu.cli", "check", hostile], capture_output=True, timeout=300)
    said = done.stdout + done.stderr
    assert b"\x1b" not in said and b"\x07" not in done.stdout
    assert b"\\x1b[2J\\x1b]0;owned\\x07" in done.stdout and b"a\\x1b[2Jb.fmu" in done.stdout
    assert len(said) < KEPT  # of 12 MB


def test_messages_of_components_are_bounded_and_what_a_terminal_acts_on_is_written_out(monkeypatch):
    assert shown("a\x1b[2J\tb\nc\r\x7f\x9b\u202e\udcff é 中") == "a\\x1b[2J\tb\nc\\r\\x7f\\x9b\\u202e\\udcff é 中"
    assert shown(shown("\x1b")) == shown("\x1b")
    box = MessageBox(lambda message: None, limit=100)
    monkeypatch.setitem(boxes, 7, ("a", box))
    for _ in range(1000):
        on_message(7, 3, b"error\x1b", b"\x1b[31m" + bytes(100) + b"x" * 100_000)
        assert len(box.pending) < 200
    last = box.pending[-1]
    assert last.text.startswith("\\x1b[31m") and last.category == "error\\x1b"
    assert last.text.endswith("(90105 bytes more)") and len(last.text) < 5 * 10_000
