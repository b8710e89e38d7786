"""A payload: a body that is part of the last link."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.spatial import skew


def link_body(robot: Any, i: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return mass [kg], centre of mass (3,) [m] and inertia (3, 3) [kg m2] of link `i`, from 0, in {B_i}.

    A payload forms one body with the last link, so the F_l of (51) is in its net force. With zero mass and inertia
    results are bit-identical to those without it.
    """
    m_B, r_B, I_B = robot.mass[i], robot.centroid[i], robot.inertia[i]
    if not robot.payload or i < robot.n - 1:
        return m_B, r_B, I_B
    m_l = robot.payload_mass[()]
    share = m_l / (m_B + m_l)
    R = robot.tool_rotation
    d = robot.tool_offset + R @ robot.payload_centroid - r_B
    d_cross = skew(d)
    return (m_B + m_l, r_B + share * d, I_B + R @ robot.payload_inertia @ R.T - (m_B * share) * (d_cross @ d_cross))
