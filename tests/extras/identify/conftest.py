"""The arm of the logs."""

import pytest

import vdfmu
from tests.engine.conftest import arm_package as arm_package
from tests.engine.conftest import results as results


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")
