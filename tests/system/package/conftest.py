"""The scenario of the planar arm and its FMUs, for all tests of packages."""

import pytest

from vdfmu.system.package.write import build_parts
from vdfmu.system.scenario import load_scenario


@pytest.fixture(scope="session")
def scenario():
    return load_scenario("planar_tracking")


@pytest.fixture(scope="session")
def fmus(scenario, tmp_path_factory):
    return build_parts(scenario, tmp_path_factory.mktemp("fmus"))
