"""What the tries of faults found: packages that never end, and a build that is refused when half of it is replaced."""

import os
import subprocess
import sys

import pytest

from tests.hostile.faults import FAULTS
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import SspError, StorageError
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
@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.name == "no working folder"])
@pytest.mark.few(1)
def test_a_working_directory_that_was_deleted_is_said(tmp_path, fault):
    command = [*fault.before, sys.executable, "-m", "vdfmu.cli", *fault.words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    said = " ".join(done.stderr.replace("│", "").split())
    assert done.returncode in (1, 2) and "Traceback" not in said and "output" not in said
    assert "The working directory was deleted: start the command in another one" in said
