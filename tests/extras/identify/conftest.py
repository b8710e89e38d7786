"""The arm of the logs."""

import pytest

import vdfmu
from tests.engine.conftest import arm_package as arm_package


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")
