"""One short run of the small arm, shared by the tests of studies."""

import pytest

import vdfmu


@pytest.fixture(scope="session")
def planar_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planar")
    return folder, vdfmu.run("planar_tracking", stop=0.2, out=folder)
