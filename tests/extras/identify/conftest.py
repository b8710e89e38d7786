"""The arm of the logs."""

import pytest

import vdfmu


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")
