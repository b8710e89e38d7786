"""The check of a file: what it says, and that a unit that crashes or hangs does not take it along."""

import pytest

from tests.engine.files import check_file, members, zipped
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


def test_what_cannot_be_opened_is_a_wrong_option(tmp_path, monkeypatch):
    for name in ("a.txt", "SystemStructure.ssd", "closed.fmu"):
        (tmp_path / name).write_text("x")
    (tmp_path / "x.fmu").mkdir()
    for name, words in {
        "missing.fmu": "there is no such file",
        "no.ssd": "there is no such file",
        "a.txt": r"cannot be checked; expected \.fmu, \.ssp, \.ssd",
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
