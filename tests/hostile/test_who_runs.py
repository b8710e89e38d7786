"""The table of who runs what, in docs/robustness.md: each command by each file that names code, which leaves a mark.

The code writes the number of its process and then fails, so that a command ends where it has run it.
"""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.added import installed
from tests.cc import CC
from tests.docs.pages import ROOT
from tests.hostile.foreign import _studied, native
from vdfmu.base import plugins
from vdfmu.cli.commands import app

PAGE = (ROOT / "docs" / "robustness.md").read_text(encoding="utf-8")
HEADS = ("command", "drive", "unit or law", "plugin", "FMU")
SHIPPED = ROOT / "models" / "robots" / "planar_2dof.toml"
SCENARIO = 'name = "x"\ndescription = "x"\nrobot = "{robot}"\nsystem = "{system}"\nstop = 0.01\nstep = 0.001\n'


def rows():
    """Yield command, head of the column and whether it runs code, of each cell of the page's tables."""
    for line in re.findall(r"^\| `.*", PAGE, re.MULTILINE):
        command, *cells = (cell.strip() for cell in line.strip("| ").replace("||", "| |").split("|"))
        if set(cells) <= {"no", "yes", "-"} and len(cells) == len(HEADS) - 1:
            for head, cell in zip(HEADS[1:], cells, strict=True):
                if cell != "-":
                    yield command.strip("`"), head, cell == "yes"


TABLE = list(rows())
MADE = {"RUN", "STUDY"}
"""Folders that take long to make."""


def marking(folder: Path) -> str:
    return f"import os\nopen({str(folder / 'mark')!r}, 'a').write(f'{{os.getpid()}} ')\nraise RuntimeError('it ran')\n"


def library(place: Path) -> bytes:
    """Return a library that writes the number of its process when it is loaded."""
    source = place.with_suffix(".c")
    source.write_text(
        "#include <stdio.h>\n#include <unistd.h>\n__attribute__((constructor)) static void run(void) {\n"
        f'FILE *f = fopen("{place.with_name("mark")}", "a"); fprintf(f, "%d ", getpid()); fclose(f); }}\n'
        "int f(const double **a, double **r, long long *i, double *w, int m) { return 0; }\n"
        "long long f_n_in(void) { return 1; }\nlong long f_n_out(void) { return 1; }\n"
    )
    subprocess.run([*CC, "-shared", "-fPIC", "-o", place.with_suffix(".so"), source], check=True)
    return place.with_suffix(".so").read_bytes()


def fmu(folder: Path) -> None:
    """Write an FMU of another tool with an output."""
    text = """<fmiModelDescription fmiVersion="2.0" modelName="x" guid="1" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="x" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables><ScalarVariable name="y" valueReference="0" causality="output" variability="continuous"><Real/>
</ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure></fmiModelDescription>"""
    with zipfile.ZipFile(folder / "x.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr("binaries/linux64/x.so", library(folder / "x"))


def robot(folder: Path, head: str) -> str:
    """Write the robot file for a column, and return its name."""
    shutil.copy(SHIPPED, folder / "plain.toml")
    if head == "plugin":
        return "marked_arm"
    (folder / "my_drive.py").write_text(marking(folder))
    text = SHIPPED.read_text(encoding="utf-8")
    (folder / "arm.toml").write_text(text.replace("[[joints]]", 'drive = "my_drive.py"\n\n[[joints]]', 1))
    return "arm.toml"


def scenario(folder: Path, head: str) -> str:
    """Write the scenario for a column: its robot, its controller or a component beside the others has the code."""
    (folder / "my_law.py").write_text(marking(folder))
    units = {"unit or law": "my_law.py", "plugin": "marked_unit"}
    lines = ['extends = "system"', "[components]"]
    if head in units:
        lines.append(f'controller = "{units[head]}"')
    if head == "FMU":
        fmu(folder)
        lines.append('beside = "x.fmu"')
    (folder / "system.toml").write_text("\n".join(['name = "y"', 'description = "y"', *lines]) + "\n")
    arm = robot(folder, head) if head == "drive" else "planar_2dof"
    (folder / "scenario.toml").write_text(SCENARIO.format(robot=arm, system="system.toml"))
    return "scenario.toml"


def study(folder: Path, head: str) -> str:
    """Copy a study of others whose controller is a file."""
    (folder / "my_law.py").write_text(marking(folder))
    _studied(folder / "study", options={"units": {"controller": str(folder / "my_law.py")}})
    return "study"


def unit(folder: Path, head: str) -> str:
    (folder / "my_law.py").write_text(marking(folder))
    return "my_law.py"


def run_of_others(folder: Path, head: str) -> str:
    native(folder / "given")
    (folder / "ran").unlink(missing_ok=True)
    return "given"


FILES = {"ROBOT": robot, "SCENARIO": scenario, "STUDY": study, "UNIT": unit, "RUN": run_of_others}


def words_of(command: str, folder: Path, head: str) -> list[str]:
    """Return the words of a command, after its files are written."""
    (folder / "log.csv").write_text("t,q1\n0,0\n")
    names = {word: make(folder, head) for word, make in FILES.items() if re.search(rf"\b{word}\b", command)}
    return [re.sub(r"^[A-Z]+", lambda word: names.get(word[0], word[0]), word) for word in command.split()]


def plugin(folder: Path) -> Path:
    """Install a package that adds a unit and a robot."""
    place = folder / "site"
    points = {"vdfmu.units": {"marked_unit": "marked:it"}, "vdfmu.robots": {"marked_arm": "marked:it"}}
    installed(place, "marked", points)
    (place / "marked.py").write_text(marking(folder))
    return place


def commands():
    """Return the commands that may meet code, by name."""
    named = {}
    for name, command in app.commands.items():
        inner = getattr(command, "commands", {"": command})
        named |= {f"{name} {each}".strip(): made for each, made in inner.items()}
    return {name: command for name, command in named.items() if command.code}


def name_of(command: str) -> str:
    return max((name for name in commands() if f"{command} ".startswith(f"{name} ")), key=len, default="")


def test_the_page_has_each_command_that_may_meet_code_and_says_of_it_what_it_is():
    assert {name_of(command) for command, *_ in TABLE} - {""} == commands().keys() - {"sweep run"}  # sweep is short
    for command, _, runs in TABLE:
        if name := name_of(command):
            looks = commands()[name].code == "looks" and "--trust" not in command
            assert not (looks and runs), command


@pytest.mark.parametrize(("command", "head"), [row[:2] for row in TABLE if not row[2] and not MADE & {*row[0].split()}])
def test_a_command_that_looks_runs_nothing(command, head, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(plugin(tmp_path))
    plugins._points.cache_clear()
    try:
        done = CliRunner().invoke(app, words_of(command, tmp_path, head))
    finally:
        plugins._points.cache_clear()
    assert not {"mark", "ran"} & {path.name for path in tmp_path.iterdir()}
    if head == "drive" and name_of(command).startswith("robot"):
        assert done.exit_code == 0, done.output
        assert "drive my_drive.py was not run, so " in done.output and "--trust runs it" in done.output
    elif "--no-run" in command and head != "FMU":
        assert "is code and was not run" in done.output.replace("\n", " ")


@pytest.mark.heavy
@pytest.mark.parametrize(("command", "head"), [row[:2] for row in TABLE if not row[2] and MADE & {*row[0].split()}])
def test_a_look_at_a_run_or_a_study_of_others_runs_nothing(command, head, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words_of(command, tmp_path, head))
    assert not {"mark", "ran"} & {path.name for path in tmp_path.iterdir()}
    if "sweep report" in command:
        assert "its scenario was not run, because the study was made elsewhere" in done.output.replace("\n", " ")
        assert "--trust runs it" in done.output.replace("\n", " ")


@pytest.mark.heavy
@pytest.mark.parametrize(("command", "head"), [row[:2] for row in TABLE if row[2]])
def test_a_command_that_computes_runs_it_in_another_process(command, head, tmp_path):
    words = words_of(command, tmp_path, head)
    path = os.pathsep.join([str(ROOT), str(plugin(tmp_path))])
    process = subprocess.Popen(
        [sys.executable, "-m", "vdfmu.cli", *words], cwd=tmp_path, env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    said, _ = process.communicate(timeout=300)
    assert (tmp_path / "mark").exists(), said
    if head == "FMU":  # libraries do not raise
        assert process.returncode >= 0 and "Traceback" not in said, said
    else:
        assert "RuntimeError: it ran" in said.replace("\n", " ") and "Traceback" not in said, said
    assert str(process.pid) not in (tmp_path / "mark").read_text().split()
