"""Arms with counterbalances."""

import pytest

from tests.conftest import TYPICAL
from vdfmu.arm.robot import load_robot, robot_from_dict

CYLINDER = {"F_cb": 200.0, "D_cb": 0.3, "r_cb": 0.1, "delta_cb": 0.4, "L_cb": 0.25}


def balanced(name="planar_2dof", *cylinders):
    """Return a shipped robot with cylinders at its first joints."""
    data = load_robot(name).to_dict()
    for i, joint in enumerate(data["joints"]):
        joint["counterbalance"] = cylinders[i] if i < len(cylinders) else {}
    return robot_from_dict(data)


ONE = balanced("slider_3dof", CYLINDER)
BOTH = balanced("planar_2dof", CYLINDER, CYLINDER | {"F_cb": 90.0, "delta_cb": -1.0, "L_cb": 0.3})
BALANCED = {"one": ONE, "both": BOTH}
EVERY_CHAIN = pytest.mark.parametrize("chain", [*TYPICAL, "general", *BALANCED], indirect=True)
"""For the laws that arms with counterbalances meet too."""
