"""Positions of the links and transformations between their frames, Eq. (32)-(36); energies from (60) and (62)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.rigid_body import mass_matrix
from vdfmu.arm.equations.spatial import force_transform, rotation_z
from vdfmu.compiler.scalar import outward
from vdfmu.compiler.scalar import total as total


def joint_rotation(robot: Any, i: int, q_i: Any) -> np.ndarray:
    """Rotation of {B_i} in {T_i}, the upper left block of Eq. (34)-(36).

    Deviation: the paper labels these matrices with "I"; they are relative to the previous link, in {T_i}. {T_i} is
    {B_(i-1)} moved to the joint without rotation, so its z axis is not the axis of joint i, contrary to the paper.
    """
    if robot.joint_types[i] == "prismatic":
        return robot.rotation[i]
    return robot.rotation[i] @ rotation_z(q_i)


def joint_placement(robot: Any, i: int, q_i: Any) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) [m] of {B_i} in {B_(i-1)} at `q_i` [rad or m]."""
    p_AB = robot.offset[i]
    if robot.joint_types[i] == "prismatic":
        p_AB = p_AB + robot.rotation[i][:, 2] * q_i
    return joint_rotation(robot, i, q_i), p_AB


def joint_placements(robot: Any, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation (3, 3) and origin (3,) [m] of every {B_i} in {B_(i-1)}, {B_0} = {I}, at `q`, from Eq. (34)-(36)."""
    return [joint_placement(robot, i, q[i]) for i in range(robot.n)]


def joint_transforms(robot: Any, q: np.ndarray) -> list[np.ndarray]:
    """Force transformations U_AB from every {B_i} to {B_(i-1)}: the product that (31) forms.

    ``U_(B_(i-1) B_i) = U_(B_(i-1) T_i) @ U_(T_i B_i)``: first a pure translation, then the joint.
    """
    return [force_transform(R_AB, p_AB) for R_AB, p_AB in joint_placements(robot, q)]


def tool_transform(robot: Any) -> np.ndarray:
    """Force transformation from the end-effector frame {O} to {B_n}, the identity for the paper's arm."""
    return force_transform(robot.tool_rotation, robot.tool_offset)


def frames(robot: Any) -> dict[str, Any]:
    """Arrays that place the frames of the links and {O}, by name."""
    return {name: getattr(robot, name) for name in ("rotation", "offset", "tool_rotation", "tool_offset")}


def poses(robot: Any, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Origins (3,) [m] and rotations (3, 3) of {I}, every {B_i} and {O} in {I}, by the products of (34)-(36)."""
    p, R = np.zeros(3), np.eye(3)
    placements = [(p, R)]
    for R_AB, p_AB in [*joint_placements(robot, q), (robot.tool_rotation, robot.tool_offset)]:
        p, R = p + R @ p_AB, R @ R_AB
        placements.append((p, R))
    return placements


def end_effector_pose(robot: Any, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) [m] and rotation (3, 3) of the end-effector frame {O} in {I}, the last of :func:`poses`."""

    def link(placed: Any, i: int) -> tuple[Any, None]:
        p, R = placed
        R_AB, p_AB = joint_placement(robot, i, q[i])
        return (p + R @ p_AB, R @ R_AB), None

    (p, R), _ = outward(link, (np.zeros(3), np.eye(3)), robot.n)
    return p + R @ robot.tool_offset, R @ robot.tool_rotation


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
    bodies = [robot.body(i) for i in range(robot.n)]
    kinetic = [0.5 * (V @ (mass_matrix(*body) @ V)) for body, V in zip(bodies, V_B, strict=True)]

    def link(placed: Any, i: int) -> tuple[Any, Any]:
        p, R = placed
        R_AB, p_AB = joint_placement(robot, i, q[i])
        m_B, r_B, _ = bodies[i]
        p, R = p + R @ p_AB, R @ R_AB
        return (p, R), m_B * (robot.gravity @ (p + R @ r_B))

    _, potential = outward(link, (p_S, R_S), robot.n)
    return LinkOutputs(p_S + R_S @ p_O, R_S @ R_O, kinetic, potential)
