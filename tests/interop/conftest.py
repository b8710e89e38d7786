"""The system, its reference and our own runs: made once for all processes of a test session."""

import os
import platform
import sys
import time

import pytest

from benchmarks import interop
from benchmarks.interop import Tracking

WHEELS = {("Linux", "x86_64"), ("Windows", "AMD64")}  # platforms that ecospy, tbb and libcosimpy have files for


@pytest.fixture(scope="session")
def tracking(tmp_path_factory):
    return made(tmp_path_factory, "vdfmu_interop")


@pytest.fixture(scope="session")
def brief(tmp_path_factory):
    """Return three seconds of it, with native FMUs."""
    return made(tmp_path_factory, "vdfmu_interop_brief", 3.0, ["native"])


def made(tmp_path_factory, name, *options):
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    done, failed = folder / "done", folder / "failed"
    try:
        folder.mkdir()
    except FileExistsError:
        end = time.monotonic() + 300.0  # it takes some 20 s of processor time
        while not done.exists():
            if failed.exists() or time.monotonic() > end:
                pytest.fail("another process of this session could not prepare the tracking system")
            time.sleep(0.1)
        return Tracking(folder, *options)
    try:
        prepared = Tracking(folder, *options).prepare()
    except BaseException:
        failed.touch()
        raise
    done.touch()
    return prepared


@pytest.fixture(scope="session")
def require():
    """Return the function ``require(tool)``: the test fails where a tool could be installed and is not."""

    def check(tool):
        here = (platform.system(), platform.machine())
        if tool in ("ecos", "libcosim") and here not in WHEELS:
            pytest.skip(f"{tool} has no binaries for {' '.join(here)}")
        if tool == "libcosim" and sys.version_info >= (3, 15):
            pytest.skip("libcosimpy has no files for Python 3.15")
        if problem := interop.missing(tool):
            pytest.fail(f"{problem}: `pip install .[test]` brings what these tests need")

    return check
