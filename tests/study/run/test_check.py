"""The check of a file: what it says, and that a unit that crashes or hangs does not take it along."""

import os
import re
import warnings
import zipfile

import pytest

from tests.engine.files import check_file
from tests.warm import command
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.engine.inspect.fmu import NOT_RUN
from vdfmu.engine.inspect.inspection import inspect_file


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return build_fmus(load_robot("planar_2dof"), tmp_path_factory.mktemp("fmus"), backend="python")


@pytest.fixture
def changed(fmus, tmp_path):
    """Copy an FMU without the files whose name starts with `left_out`, with other texts instead of some."""

    def change(left_out, texts=None):
        path = tmp_path / "Plant.fmu"
        with zipfile.ZipFile(fmus["plant"]) as source, zipfile.ZipFile(path, "w") as target:
            for name in source.namelist():
                if not name.startswith(left_out):
                    target.writestr(name, (texts or {}).get(name, source.read(name)))
        return path

    return change


SCRIPT = "resources/vdfmu_plant_slave.py"


@pytest.mark.heavy
def test_a_good_fmu_has_no_problems(fmus):
    for path in fmus.values():
        assert check_file(path) == []


@pytest.mark.heavy
def test_an_entry_that_is_there_twice_with_one_content_is_a_note(changed):
    path = changed("nothing")
    with zipfile.ZipFile(path, "a") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file.writestr(SCRIPT, file.read(SCRIPT))
    report = inspect_file(path)
    assert (report.problems, report.ran) == ([], True)
    assert report.notes == [f"entry {SCRIPT!r} occurs more than once, with the same content"]


@pytest.mark.heavy
def test_what_the_process_leaves_is_removed(fmus, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert check_file(fmus["plant"]) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.heavy
def test_a_unit_without_its_script_is_a_problem_and_not_a_crash(changed, tmp_path):
    path = changed(SCRIPT)
    (problem,) = check_file(path)
    assert "10 steps" in problem
    done = command("check", path, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "1 problem(s)" in done.stdout
    assert check_file(path, run=False) == []


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_unit_that_ends_its_process_is_reported_with_the_signal(changed):
    path = changed("none", {SCRIPT: "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n"})
    (problem,) = check_file(path)
    assert problem.startswith("the process crashed (signal 11) in instantiate of a run of 10 steps")


def test_a_unit_that_ends_its_process_without_an_error_is_reported(changed):
    path = changed("none", {SCRIPT: "import os\nos._exit(0)\n"})
    assert check_file(path) == ["the unit ended the process in instantiate of a run of 10 steps"]


def test_a_binary_for_another_platform_only_is_named(changed):
    path = changed("binaries/")
    with zipfile.ZipFile(path, "a") as target:
        target.writestr("binaries/plan9/Plant.so", b"\x7fELF")
    (problem,) = check_file(path)
    assert problem.startswith("no binary for this platform")


@pytest.mark.parametrize("name", ["missing.fmu", "no.ssd"])
def test_a_missing_file_is_a_wrong_option(tmp_path, name):
    with pytest.raises(UsageError, match="there is no such file"):
        check_file(tmp_path / name)


def test_what_breaks_a_rule_is_not_run(changed):
    """A script that would end the process, which a fault of the description keeps from being run."""
    code = {SCRIPT: "import os\nos._exit(0)\n"}
    with zipfile.ZipFile(changed("none", code)) as archive:
        text = archive.read("modelDescription.xml").replace(b'unit="rad/s"', b'unit="rad/h"')
    report = inspect_file(changed("none", {**code, "modelDescription.xml": text}))
    assert report.problems and not report.ran
    assert all(p.startswith('The unit "rad/h" of variable ') for p in report.problems)
    assert report.notes == [NOT_RUN]


def test_a_binary_that_is_none_is_found_without_running_it(changed):
    with zipfile.ZipFile(changed("none")) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith("linux64/Plant.so"))
    path = changed("none", {name: b"no library"})
    for run in (False, True):
        report = inspect_file(path, run=run)
        assert report.problems == [f"{name}: is not a shared library of the kind in its name"]
        assert not report.ran
    (problem,) = check_file(changed(name, {}), run=False)
    assert problem.startswith("no binary for this platform")


def test_files_that_are_no_fmu(tmp_path):
    for name, data in {"text.fmu": b"hello", "empty.fmu": b"", "cut.fmu": b"PK\x03\x04"}.items():
        (tmp_path / name).write_bytes(data)
        (problem,) = check_file(tmp_path / name)
        assert problem.startswith(f"{name} is not a readable FMU: cannot be read as a zip package")
    for text, words in {
        "<a/>": "expected the root fmiModelDescription, got 'a'",
        "<a>": "is not well-formed XML",
        '<fmiModelDescription fmiVersion="4.0"/>': "fmiVersion is '4.0'; expected 1.0, 2.0 or 3.0",
        '<fmiModelDescription fmiVersion="2.0"/>': "modelName",
    }.items():
        with zipfile.ZipFile(tmp_path / "x.fmu", "w") as file:
            file.writestr("modelDescription.xml", text)
        assert words in " ".join(check_file(tmp_path / "x.fmu"))
    with zipfile.ZipFile(tmp_path / "x.fmu", "w") as file:
        file.writestr("SystemStructure.ssd", "")
    (problem,) = check_file(tmp_path / "x.fmu")
    assert problem.endswith("it has no 'modelDescription.xml'; it is a package of SSP, name it .ssp")


def test_an_fmu_of_fmi_1_and_one_without_co_simulation_are_told_in_words(tmp_path):
    description = (
        '<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="1" '
        'numberOfContinuousStates="0" numberOfEventIndicators="0"><ModelVariables/></fmiModelDescription>'
    )
    exchange = (
        '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1"><ModelExchange modelIdentifier="m"/>'
        "<ModelVariables/><ModelStructure/></fmiModelDescription>"
    )
    for text, standard, note in (
        (description, "FMI 1.0", "FMI 1.0 for model exchange: fmpy runs it"),
        (exchange, "FMI 2.0", "no co-simulation: a master needs it"),
    ):
        with zipfile.ZipFile(tmp_path / "m.fmu", "w") as file:
            file.writestr("modelDescription.xml", text)
        report = inspect_file(tmp_path / "m.fmu")
        assert (report.kind, report.standard, report.ran) == ("FMU", standard, False)
        assert any(n.startswith(note) for n in report.notes)
        assert any(p.startswith("no binary for this platform") for p in report.problems)


def test_what_cannot_be_opened_is_a_wrong_option(tmp_path, monkeypatch):
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(UsageError, match=r"not of a kind that can be checked; expected \.fmu, \.ssp, \.ssd"):
        check_file(tmp_path / "a.txt")
    (tmp_path / "x.fmu").mkdir()
    with pytest.raises(UsageError, match="is a folder; expected a file"):
        check_file(tmp_path / "x.fmu")
    (tmp_path / "SystemStructure.ssd").write_text("")
    with pytest.raises(UsageError, match=r"is a folder; give .*SystemStructure\.ssd"):
        check_file(tmp_path)
    (tmp_path / "closed.fmu").write_bytes(b"x")

    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(UsageError, match="cannot be opened: Permission denied"):
        check_file(tmp_path / "closed.fmu")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('fmiVersion="2.0"', 'fmiVersion="2.0.4"', "fmiVersion is '2.0.4'; expected 1.0, 2.0 or 3.0"),
        ('fmiVersion="2.0"', 'fmiVersion=""', "has no fmiVersion"),
        ("<DefaultExperiment", "<DefaultExperiment tolerance='1' stepSize='-1'", "stepSize is '-1'; expected"),
    ],
)
def test_a_version_or_experiment_that_is_odd_is_told_and_not_run(fmus, changed, old, new, said):
    with zipfile.ZipFile(fmus["plant"]) as archive:
        text = archive.read("modelDescription.xml").decode()
    if new.startswith("<Default"):
        text = re.sub(r"<DefaultExperiment[^/>]*", new, text)
    text = text.replace(old, new) if not new.startswith("<Default") else text
    report = inspect_file(changed("\0", {"modelDescription.xml": text}))
    assert any(said in problem for problem in report.problems)
    assert not report.ran
    assert report.notes[-1] == NOT_RUN
