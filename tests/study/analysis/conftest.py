"""An arm of one joint."""

import pytest

import vdfmu
from tests.study.analysis.lift import ONE_JOINT


@pytest.fixture
def lift(tmp_path):
    (tmp_path / "lift.toml").write_text(ONE_JOINT)
    return vdfmu.load_robot(tmp_path / "lift.toml")
