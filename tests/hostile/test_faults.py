"""What the tries of faults found: packages that never end, and a build that is refused when half of it is replaced."""

import os

import pytest

from tests.hostile.faults import FAULTS, met
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import SspError, StorageError, VdfmuError
from vdfmu.engine.package.read import load_ssp


def test_a_package_that_is_no_regular_file_is_refused(tmp_path):
    """A device never ends, and a pipe is waited for."""
    (tmp_path / "device.ssp").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe.ssp")
    for name in ("device.ssp", "pipe.ssp"):
        with pytest.raises(SspError, match=f"{name}: is a pipe, a device or another special file"):
            load_ssp(tmp_path / name)


def test_a_build_looks_at_all_places_before_it_replaces_the_first(planar, tmp_path):
    (tmp_path / "PDController.fmu").mkdir()
    with pytest.raises(StorageError, match=r"PDController\.fmu: is a folder"):
        build_fmus(planar, tmp_path, units=["trajectory", "controller"], backend="python", folded=True)
    assert [path.name for path in tmp_path.iterdir()] == ["PDController.fmu"]


@pytest.mark.skipif(os.name != "posix", reason="another system keeps a folder that is in use")
@pytest.mark.parametrize("number", [k for k, fault in enumerate(FAULTS) if fault.name == "no working folder"])
def test_a_working_directory_that_was_deleted_is_said(tmp_path, number):
    with pytest.raises(VdfmuError, match="The working directory was deleted: start the command in another one") as said:
        met(number, tmp_path)
    assert "output" not in str(said.value)
