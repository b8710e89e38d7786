"""Small URDFs to import and to break, and what Pinocchio makes of them."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

import vdfmu
from vdfmu.arm.robot import Robot

INERTIAL = """<inertial><origin xyz="0.1 0.02 0.3" rpy="0.1 0.2 0.3"/><mass value="2"/>
<inertia ixx="0.03" iyy="0.04" izz="0.02" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial>"""
LIMIT = '<limit lower="-2" upper="1.5" effort="50" velocity="3"/>'


def link(name: str, inside: str = INERTIAL) -> str:
    return f'<link name="{name}">{inside}</link>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    axis: str = "0 0 1",
    inside: str = LIMIT,
    origin: str = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/>',
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'{origin}<axis xyz="{axis}"/>{inside}</joint>\n'
    )


ARM = (
    link("ground", "")
    + link("one")
    + link("two")
    + link("cap")
    + link("three")
    + link("tool", "")
    + joint("a", "ground", "one", axis="0 1 0")
    + joint("b", "one", "two", axis="-0.3 0.5 -2")
    + joint("glue", "two", "cap", "fixed")
    + joint("c", "cap", "three", "prismatic", axis="0 0 -1")
    + joint("end", "three", "tool", "fixed")
)
"""Two turns, a slide, axes in several directions, a link that is fixed to another, a tool without mass."""


@pytest.fixture
def urdf(tmp_path):
    def write(content: str, name: str = "arm.urdf") -> Path:
        path = tmp_path / name
        path.write_text(f'<robot name="arm">\n{content}</robot>\n', encoding="utf-8")
        return path

    return write


def pinocchio_arm(path: Path, moving: list[str]) -> pin.Model:
    """Return Pinocchio's model of a URDF, all joints fixed but those that move."""
    root = etree.parse(path).getroot()
    for element in root.findall("joint"):
        if element.get("name") not in moving:
            element.set("type", "fixed")
    model = pin.buildModelFromXML(etree.tostring(root).decode())
    assert list(model.names)[1:] == moving
    return model


def differences(robot: Robot, model: pin.Model, states: int, scale: float = 2.0, seed: int = 1) -> tuple[float, float]:
    data, random = model.createData(), np.random.default_rng(seed)
    q, q_dot, q_ddot = random.uniform(-scale, scale, (3, states, robot.n))
    turns = [model.joints[i + 1].nq == 2 for i in range(robot.n)]  # a continuous joint is a point on a circle
    torques, accelerations = [], []
    for k in range(states):
        at = np.concatenate([[np.cos(x), np.sin(x)] if turn else [x] for x, turn in zip(q[k], turns, strict=True)])
        torques.append(pin.rnea(model, data, at, q_dot[k], q_ddot[k]).copy())
        accelerations.append(pin.aba(model, data, at, q_dot[k], torques[k]).copy())

    def relative(ours: np.ndarray, theirs: list[np.ndarray]) -> float:
        return float((np.abs(ours - theirs).max(axis=1) / np.abs(theirs).max(axis=1)).max())

    return (
        relative(vdfmu.dynamics.inverse_dynamics(robot, q, q_dot, q_ddot), torques),
        relative(vdfmu.dynamics.forward_dynamics(robot, q, q_dot, np.array(torques)), accelerations),
    )


def largest_difference(path: Path, robot: Robot, joints: list[str], states: int = 20) -> float:
    """Return the largest relative difference of inverse dynamics to those of MuJoCo, all other joints at 0."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for parameters in (model.dof_damping, model.dof_armature, model.dof_frictionloss, model.jnt_stiffness):
        parameters[:] = 0  # of the drives, which a robot of vdfmu has beside its links
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    places = [model.joint(name) for name in joints]
    worst, random = 0.0, np.random.default_rng(2)
    for q, q_dot, q_ddot in random.uniform(-1, 1, (states, 3, robot.n)):
        data.qpos[:] = 0.0
        data.qvel[:] = 0.0
        data.qacc[:] = 0.0
        for place, *values in zip(places, q, q_dot, q_ddot, strict=True):
            data.qpos[place.qposadr], data.qvel[place.dofadr], data.qacc[place.dofadr] = values
        mujoco.mj_inverse(model, data)
        theirs = np.array([data.qfrc_inverse[place.dofadr[0]] for place in places])
        ours = vdfmu.dynamics.inverse_dynamics(robot, q, q_dot, q_ddot)
        worst = max(worst, float(np.abs(ours - theirs).max() / np.abs(theirs).max()))
    return worst
