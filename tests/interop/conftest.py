"""The system, its reference and our own runs: made once for all processes of a test session."""

import platform
import sys

import pytest

from benchmarks import interop
from benchmarks.interop import Tracking
from tests.conftest import alone

WHEELS = {("Linux", "x86_64"), ("Windows", "AMD64")}  # platforms that ecospy, tbb and libcosimpy have files for


@pytest.fixture(scope="session")
def tracking(kernel_cache):
    return made(kernel_cache, "vdfmu_interop")


@pytest.fixture(scope="session")
def brief(kernel_cache):
    """Return three seconds of it, with native FMUs."""
    return made(kernel_cache, "vdfmu_interop_brief", 3.0, ["native"])


def made(kernel_cache, name, *options):
    folder = kernel_cache.with_name(name)
    tracking, done = Tracking(folder, *options), folder / "done"
    with alone(kernel_cache):
        if not done.exists():
            folder.mkdir(exist_ok=True)
            tracking.prepare()
            done.touch()
    return tracking


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
