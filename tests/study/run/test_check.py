"""The check of a file: what it says, and that a unit that crashes or hangs does not take it along."""

import os
import re
import warnings
import zipfile

import pytest

from tests.engine.files import check_file, zipped
from tests.study.run.conftest import members
from tests.warm import command
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.engine.inspect.fmu import NOT_RUN
from vdfmu.engine.inspect.inspection import inspect_file


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return build_fmus(load_robot("planar_2dof"), tmp_path_factory.mktemp("fmus"), backend="python", folded=True)


@pytest.fixture
def changed(fmus, tmp_path):
    """Copy an FMU without the files whose name starts with `left_out`, with other texts instead of some."""

    def change(left_out, texts=None):
        kept = {name: data for name, data in members(fmus["plant"]).items() if not name.startswith(left_out)}
        (tmp_path / "Plant.fmu").write_bytes(zipped(kept | (texts or {})))
        return tmp_path / "Plant.fmu"

    return change


SCRIPT = "resources/vdfmu_plant_slave.py"


@pytest.mark.heavy
def test_a_good_fmu_has_no_problems_and_its_process_leaves_nothing(fmus, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for path in fmus.values():
        assert check_file(path) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.heavy
def test_an_entry_that_is_there_twice_is_a_note_and_one_that_is_missing_a_problem(changed, tmp_path):
    path = changed("nothing")
    with zipfile.ZipFile(path, "a") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file.writestr(SCRIPT, file.read(SCRIPT))
    report = inspect_file(path)
    assert (report.problems, report.ran) == ([], True)
    assert report.notes == [f"entry {SCRIPT!r} occurs more than once, with the same content"]
    path = changed(SCRIPT)
    (problem,) = check_file(path)
    assert "10 steps" in problem
    done = command("check", path, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "1 problem" in done.stdout
    assert check_file(path, run=False) == []


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(("code", "said"), [
    ("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n", "the process crashed (signal 11) in instantiate of"),
    ("import os\nos._exit(0)\n", "the unit ended the process in instantiate of a run of 10 steps"),
])  # fmt: skip
def test_a_unit_that_ends_its_process_is_reported(changed, code, said):
    (problem,) = check_file(changed("none", {SCRIPT: code}))
    assert problem.startswith(said)


def test_what_cannot_be_opened_is_a_wrong_option(tmp_path, monkeypatch):
    for name in ("a.txt", "SystemStructure.ssd", "closed.fmu"):
        (tmp_path / name).write_text("x")
    (tmp_path / "x.fmu").mkdir()
    for name, words in {
        "missing.fmu": "there is no such file",
        "no.ssd": "there is no such file",
        "a.txt": r"not of a kind that can be checked; expected \.fmu, \.ssp, \.ssd",
        "x.fmu": "is a folder; expected a file",
        "": r"is a folder; give .*SystemStructure\.ssd",
    }.items():
        with pytest.raises(UsageError, match=words):
            check_file(tmp_path / name)

    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(UsageError, match="cannot be opened: Permission denied"):
        check_file(tmp_path / "closed.fmu")


def test_what_breaks_a_rule_is_not_run(fmus, changed):
    """A script that would end the process, which a fault of the description keeps from being run."""
    text = members(fmus["plant"])["modelDescription.xml"].replace(b'unit="rad/s"', b'unit="rad/h"')
    report = inspect_file(changed("none", {SCRIPT: "import os\nos._exit(0)\n", "modelDescription.xml": text}))
    assert report.problems and not report.ran
    assert all(p.startswith('The unit "rad/h" of variable ') for p in report.problems)
    assert report.notes == [NOT_RUN]


def test_a_binary_that_is_none_is_found_without_running_it(fmus, changed):
    (name,) = (n for n in members(fmus["plant"]) if n.endswith("linux64/Plant.so"))
    path = changed("none", {name: b"no library"})
    for run in (False, True):
        report = inspect_file(path, run=run)
        assert report.problems == [f"{name}: is not a shared library of the kind in its name"]
        assert not report.ran
    (problem,) = check_file(changed(name, {}), run=False)  # those for other platforms are there
    assert problem.startswith("no binary for this platform")


def test_files_that_are_no_fmu(tmp_path):
    for name, data in {"text.fmu": b"hello", "empty.fmu": b"", "cut.fmu": b"PK\x03\x04"}.items():
        (tmp_path / name).write_bytes(data)
        (problem,) = check_file(tmp_path / name)
        assert problem.startswith(f"{name} is not a readable FMU: cannot be read as a zip package")
    for name, text, words in (
        ("modelDescription.xml", "<a/>", "expected the root fmiModelDescription, got 'a'"),
        ("modelDescription.xml", "<a>", "is not well-formed XML"),
        ("modelDescription.xml", '<fmiModelDescription fmiVersion="2.0"/>', "modelName"),
        ("SystemStructure.ssd", "", "it has no 'modelDescription.xml'; it is a package of SSP, name it .ssp"),
    ):
        (tmp_path / "x.fmu").write_bytes(zipped({name: text}))
        assert words in " ".join(check_file(tmp_path / "x.fmu"))


OLD = """<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="1" numberOfContinuousStates="0"
numberOfEventIndicators="0"><ModelVariables/></fmiModelDescription>"""
EXCHANGE = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1"><ModelExchange modelIdentifier="m"/>
<ModelVariables/><ModelStructure/></fmiModelDescription>"""


@pytest.mark.parametrize(("text", "standard", "note"), [
    (OLD, "FMI 1.0", "FMI 1.0 for model exchange: fmpy runs it"),
    (EXCHANGE, "FMI 2.0", "no co-simulation: a master needs it"),
])  # fmt: skip
def test_an_fmu_of_fmi_1_and_one_without_co_simulation_are_told_in_words(tmp_path, text, standard, note):
    (tmp_path / "m.fmu").write_bytes(zipped({"modelDescription.xml": text}))
    report = inspect_file(tmp_path / "m.fmu")
    assert (report.kind, report.standard, report.ran) == ("FMU", standard, False)
    assert any(n.startswith(note) for n in report.notes)
    assert any(p.startswith("no binary for this platform") for p in report.problems)


@pytest.mark.parametrize(("old", "new", "said"), [
    ('fmiVersion="2.0"', 'fmiVersion="2.0.4"', "fmiVersion is '2.0.4'; expected 1.0, 2.0 or 3.0"),
    ('fmiVersion="2.0"', 'fmiVersion=""', "has no fmiVersion"),
    ("<DefaultExperiment[^/>]*", "<DefaultExperiment tolerance='1' stepSize='-1'", "stepSize is '-1'; expected"),
])  # fmt: skip
def test_a_version_or_experiment_that_is_odd_is_told_and_not_run(fmus, changed, old, new, said):
    text = re.sub(old, new, members(fmus["plant"])["modelDescription.xml"].decode())
    report = inspect_file(changed("\0", {"modelDescription.xml": text}))
    assert any(said in problem for problem in report.problems)
    assert not report.ran
    assert report.notes[-1] == NOT_RUN
