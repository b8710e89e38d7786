"""Robots as files of other tools: MJCF of MuJoCo, and URDF."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.arm.equations.flexible_joint import spring
from vdfmu.arm.robot import Robot, check_robot, load_robot
from vdfmu.arm.robot.parameters import JOINT_OPTIONS
from vdfmu.arm.robot.physical import check_inertia
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.option import checks_types
from vdfmu.base.text import FORBIDDEN, shown
from vdfmu.base.toml_tables import Problems
from vdfmu.extras.robots.drives import FULL
from vdfmu.extras.robots.tree import Mass, joined

FORMS = ("mjcf", "urdf")
_SUFFIXES = {".xml": "mjcf", ".mjcf": "mjcf", ".urdf": "urdf"}
_NONE = 1e6
"""Position that importers write for a missing end stop."""
_SPLIT_OFF = 1e-6
"""Mass of a rotor's body [kg], taken from the link that carries it, because MuJoCo needs a mass."""
_LEAST = 1e-9
"""Inertia of a rotor's body relative to its armature, which has the whole inertia in pure rotation."""
_STEP = 5e-4
"""Step of the file [s]: a twentieth of the period of a spring of 100 Hz."""


class ExportedJoint(NamedTuple):
    """The numbers of one joint, in SI units.

    `rotor` is the inertia of the rotor about its axis, `effort` the largest torque of the motor, infinite for none.
    Friction is viscous and Coulomb, on the link link-side, on the rotor motor-side.
    """

    name: str
    slides: bool
    R: Floats
    p: Floats
    body: Mass
    stops: tuple[float, float] | None
    stiffness: float
    rotor: float
    ell: float
    link_friction: tuple[float, float]
    rotor_friction: tuple[float, float]
    effort: float

    @property
    def friction(self) -> tuple[float, float]:
        """Friction on a rigid joint, link-side."""
        (f_v, f_c), (m_v, m_c) = self.link_friction, self.rotor_friction
        return f_v + self.ell**2 * m_v, f_c + self.ell * m_c


@checks_types
def export_robot(
    robot: Robot | str | os.PathLike[str], path: str | os.PathLike[str], to: str | None = None, *, rigid: bool = False
) -> list[str]:
    """Write a robot as MJCF or URDF.

    In MJCF a rotor is a body on the link that carries it, connected by a spring to the link that it drives. URDF has
    rigid links.

    Parameters
    ----------
    robot : Robot, str or path
        Robot, its name or its file.
    path : path
        File to write. It is replaced.
    to : "mjcf" or "urdf", optional
        By default chosen by the suffix: ``.xml`` and ``.mjcf``, or ``.urdf``.
    rigid : bool
        MJCF with rigid joints, and rotors as their armature.

    Returns
    -------
    list of str
        Notes on numbers that the file cannot contain.

    Raises
    ------
    UsageError, ModelError
        For another format, or a robot that is not physical.
    """
    arm = check_robot(robot if isinstance(robot, Robot) else load_robot(robot))
    form = to or _SUFFIXES.get(Path(path).suffix.lower(), "")
    if form not in FORMS:
        raise UsageError(f"to must be {' or '.join(FORMS)}, got {to or Path(path).name!r}. Choose one.")
    if rigid and form == "urdf":
        raise UsageError("rigid must be False for a URDF, got True. Its joints are rigid anyway.")
    text, notes = _mjcf(arm, rigid) if form == "mjcf" else _urdf(arm)
    write_whole(Path(path), [text])
    return notes


def _joints(robot: Robot) -> Iterator[ExportedJoint]:
    compliance = np.broadcast_to(spring(robot, np.zeros(robot.n)).compliance, robot.n)
    split = robot.friction == "split"
    for i, kind in enumerate(robot.joint_types):
        ell, f_v, f_c, *stops = (float(a[i]) for a in (robot.ell, robot.f_v, robot.f_c, robot.q_min, robot.q_max))
        yield ExportedJoint(
            name=(robot.joint_names[i] if robot.joint_names else "") or f"joint_{i + 1}",
            slides=JOINT_TYPES[kind].slides, R=robot.rotation[i], p=robot.offset[i], body=Mass(*robot.body(i)),
            stops=(stops[0], stops[1]) if robot.limits and min(map(abs, stops)) < _NONE else None,
            stiffness=float(1.0 / compliance[i]), rotor=float(robot.I_m[i]) / ell, ell=ell,
            link_friction=(f_v, f_c) if split else (0.0, 0.0),
            rotor_friction=(0.0, float(robot.f_ck[i])) if split else (f_v / ell**2, f_c / ell),
            effort=float(robot.tau_stall[i]) if robot.limits else np.inf,
        )  # fmt: skip


def _left_out(robot: Robot, form: str, springs: bool) -> Iterator[str]:
    """Yield notes on the robot's numbers that a file cannot contain."""
    if not springs:
        yield "springs of the drives: K_f0, c_f, K_w0, c_w."
        if form == "MJCF" and robot.rotor_coupling:
            yield "turning of the rotors with the links that carry them: rotor_coupling."
    elif np.any(robot.c_f > 1e-6) or np.any(robot.c_w > 1e-6):
        yield "stiffening of the springs: c_f, c_w. A spring has its stiffness at zero torque."
    if form == "URDF":
        yield "ratio and inertia of the rotors: ell, I_m."
        if not np.array_equal(robot.gravity, [0.0, 0.0, 9.81]):
            yield f"gravity: {_numbers(robot.gravity)} m/s2, upward."
    if np.any(robot.f_s > robot.f_c):
        yield "Stribeck friction: f_s, v_s. Dry friction is f_c at all speeds."
    if np.any(robot.theta_err_amplitude):
        yield "kinematic error of the drives: theta_err_amplitude, theta_err_phase."
    if robot.limits:
        motor = "full_speed" if form == "URDF" else "kappa_dot_max, full_speed"
        yield f"springs of the end stops, torque-speed line: stop_stiffness, stop_damping, {motor}."
    tables = [name for name in JOINT_OPTIONS if name != "limits" and getattr(robot, name)] + robot.own_sections()
    if tables:
        yield f"tables of the drives: {', '.join(tables)}."
    if robot.moving_base or robot.coupled_tool:
        yield "inputs of a moving base or a coupled tool."
    if robot.visuals:
        yield "shapes for pictures."


def _mjcf(robot: Robot, rigid: bool) -> tuple[bytes, list[str]]:
    joints, notes = list(_joints(robot)), list(_left_out(robot, "MJCF", not rigid))
    root = etree.Element("mujoco", model=robot.name)
    _add(root, "compiler", angle="radian", autolimits="true")
    _add(root, "option", timestep=_STEP, integrator="implicitfast", gravity=-robot.gravity)
    at, tendons, motors = _add(root, "worldbody"), etree.Element("tendon"), etree.Element("actuator")
    for i, joint in enumerate(joints):
        frame = {"pos": joint.p, "quat": _quaternion(joint.R)}
        rotor, driven = f"{joint.name}_rotor", joint.name
        if not rigid:
            motor, driven = _add(at, "body", name=f"rotor_{i + 1}", **frame), rotor
            axial = joint.rotor * (1.0 if robot.rotor_coupling else _LEAST)
            _add(motor, "inertial", pos=np.zeros(3), mass=_SPLIT_OFF, diaginertia=axial * np.array([0.5, 0.5, 1.0]))
            _joint(motor, rotor, False, joint.rotor_friction, 0.0 if robot.rotor_coupling else joint.rotor)
            bends = _add(tendons, "fixed", name=f"spring_{i + 1}", stiffness=joint.stiffness, springlength=0.0)
            _add(bends, "joint", joint=rotor, coef=1.0 / joint.ell)
            _add(bends, "joint", joint=joint.name, coef=-1.0)
        at = _add(at, "body", name=f"link_{i + 1}", **frame)
        outer = joints[i + 1] if i + 1 < robot.n and not rigid else None
        body = joint.body if outer is None else _without_rotor(joint.body, outer, robot.rotor_coupling)
        if body is None:
            body = joint.body
            notes.append(f"link {i + 1} is too slender to give rotor {i + 2} its transverse inertia, and keeps it.")
        I_B = body.inertia
        _add(at, "inertial", pos=body.centroid, mass=body.mass,
             fullinertia=[*np.diag(I_B), I_B[0, 1], I_B[0, 2], I_B[1, 2]])  # fmt: skip
        friction = joint.friction if rigid else joint.link_friction
        _joint(at, joint.name, joint.slides, friction, joint.rotor * joint.ell**2 if rigid else 0.0, joint.stops)
        force = {"ctrlrange": [-joint.effort, joint.effort]} if np.isfinite(joint.effort) else {}
        _add(motors, "motor", name=f"motor_{i + 1}", joint=driven, gear=joint.ell if rigid else 1.0, **force)
    _add(at, "body", name="tool", pos=robot.tool_offset, quat=_quaternion(robot.tool_rotation))
    if len(tendons):
        root.append(tendons)
    root.append(motors)
    return _written(robot, root, "MJCF", notes), notes


def _joint(
    body: Any,
    name: str,
    slides: bool,
    friction: tuple[float, float],
    armature: float,
    stops: tuple[float, float] | None = None,
) -> None:
    """Add a joint about z to a body of MJCF."""
    sizes = {"damping": friction[0], "frictionloss": friction[1], "armature": armature, "range": stops}
    kind = "slide" if slides else "hinge"
    _add(body, "joint", name=name, type=kind, axis=[0, 0, 1], **{key: value for key, value in sizes.items() if value})


def _without_rotor(link: Mass, joint: ExportedJoint, coupled: bool) -> Mass | None:
    """Return a link without the rotor of the joint after it, or None if no rigid body is left."""
    across = 0.5 * joint.rotor * (1.0 if coupled else _LEAST)
    inertia = joint.R @ np.diag([across, across, 0.0]) @ joint.R.T
    body = joined([link, Mass(-_SPLIT_OFF, joint.p, -inertia)])
    problems = Problems("")
    check_inertia(problems, "", body.inertia)
    return None if problems.lines or body.mass <= 0.0 else body


def _urdf(robot: Robot) -> tuple[bytes, list[str]]:
    joints, notes = list(_joints(robot)), list(_left_out(robot, "URDF", False))
    root = etree.Element("robot", name=robot.name)
    _add(root, "link", name="base")
    for i, joint in enumerate(joints):
        link = _add(root, "link", name=f"link_{i + 1}")
        inertial, I_B = _add(link, "inertial"), joint.body.inertia
        _add(inertial, "origin", xyz=joint.body.centroid)
        _add(inertial, "mass", value=joint.body.mass)
        _add(inertial, "inertia", **{f"i{'xyz'[j]}{'xyz'[k]}": I_B[j, k] for j in range(3) for k in range(j, 3)})
        kind = "prismatic" if joint.slides else "revolute" if joint.stops else "continuous"
        before = f"link_{i}" if i else "base"
        moving = _urdf_joint(root, joint.name, kind, before, f"link_{i + 1}", joint.R, joint.p)
        _add(moving, "axis", xyz=[0, 0, 1])
        stops = joint.stops or ((-_NONE, _NONE) if joint.slides else None)
        limits = dict(zip(("lower", "upper"), stops, strict=True)) if stops else {}
        if limits or robot.limits:
            speed = float(np.maximum(robot.full_speed[i], FULL) * robot.kappa_dot_max[i]) if robot.limits else _NONE
            _add(moving, "limit", **limits, effort=min(joint.effort * joint.ell, _NONE), velocity=speed)
        _add(moving, "dynamics", damping=joint.friction[0], friction=joint.friction[1])
    _add(root, "link", name="tool")
    _urdf_joint(root, "tool_mount", "fixed", f"link_{robot.n}", "tool", robot.tool_rotation, robot.tool_offset)
    return _written(robot, root, "URDF", notes), notes


def _urdf_joint(root: Any, name: str, kind: str, parent: str, child: str, R: Floats, p: Floats) -> Any:
    joint = _add(root, "joint", name=name, type=kind)
    _add(joint, "parent", link=parent)
    _add(joint, "child", link=child)
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)  # the others follow from any yaw, so a pitch of 90 degrees is no special case
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    _add(joint, "origin", xyz=p, rpy=[roll, np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])), yaw])
    return joint


def _quaternion(R: Floats) -> Floats:
    """Return the quaternion w, x, y, z of a rotation."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat()[[3, 0, 1, 2]]


def _add(parent: Any, tag: str, **attributes: Any) -> Any:
    texts = {key: value if isinstance(value, str) else _numbers(value) for key, value in attributes.items()}
    return etree.SubElement(parent, tag, texts)


def _numbers(value: Any) -> str:
    return " ".join(repr(float(number) + 0.0).removesuffix(".0") for number in np.ravel(value))


def _written(robot: Robot, root: Any, form: str, notes: list[str]) -> bytes:
    """Return the file with a comment: its robot, the omitted parameters, and the sources of numbers."""
    lines = [f"Robot {robot.name} of vdfmu. {robot.description}", "SI units, angles in rad."]
    lines += [f"{form} does not have:", *(f"  {note}" for note in notes)] if notes else []
    lines += ["Sources:", *(f"  {key}: {text}" for key, text in robot.sources.items())] if robot.sources else []
    text = re.sub("-(?=-)", "- ", "\n".join(shown(line, FORBIDDEN) for line in lines))
    root.insert(0, etree.Comment(f"\n{text}\n"))
    return etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="utf-8")
