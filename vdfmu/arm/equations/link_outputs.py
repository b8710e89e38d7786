"""Outputs of the links: pose of the end effector by Eq. (34)-(36), and energies of the bodies, by (60) and (62)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.kinematics import end_effector_pose, joint_placements
from vdfmu.arm.equations.rigid_body import mass_matrix


class LinkOutputs(NamedTuple):
    """Pose of the end effector in {I}, (3,) [m] and (3, 3), and energies of the links, n times [J] each."""

    p_O: Any
    R_O: Any
    kinetic: list[Any]
    potential: list[Any]


def link_outputs(robot: Any, q: np.ndarray, V_B: list[np.ndarray], p_S: Any, R_S: Any) -> LinkOutputs:
    """Return the outputs of the links. The potential energy is 0 with a centre of mass at the height of {I}'s origin.

    `V_B` are the velocities of the links, `p_S` (3,) [m] and `R_S` (3, 3) place and rotate the base in {I}.
    """
    p_O, R_O = end_effector_pose(robot, q)
    outputs = LinkOutputs(p_S + R_S @ p_O, R_S @ R_O, [], [])
    p, R = p_S, R_S
    for i, (R_AB, p_AB) in enumerate(joint_placements(robot, q)):
        m_B, r_B, I_B = robot.body(i)
        outputs.kinetic.append(0.5 * (V_B[i] @ (mass_matrix(m_B, r_B, I_B) @ V_B[i])))
        p, R = p + R @ p_AB, R @ R_AB
        outputs.potential.append(m_B * (robot.gravity @ (p + R @ r_B)))
    return outputs
