"""Arms that are wired from their links and joints: the same as those in one piece."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import heavy, make_general_chain
from tests.extras.decompose.torso import scenario_of, torso
from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.forward_dynamics import articulated
from vdfmu.arm.equations.kinematics import joint_placement
from vdfmu.arm.equations.plant import plant_derivative
from vdfmu.arm.equations.rigid_body import bias_force, mass_matrix
from vdfmu.arm.equations.spatial import force_transform, joint_axis
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.units import package_units
from vdfmu.arm.world.attachment import moving_base
from vdfmu.base.errors import UsageError
from vdfmu.extras.decompose.decomposition import decomposed
from vdfmu.system.scenario.system_file import SystemFile


class Wired:
    """The components of a system as Python objects, whose values are carried over its connections.

    Where no output depends on itself, three sweeps settle all: velocities to the tip, forces back, accelerations.
    """

    def __init__(
        self, units: Mapping[str, Any], connections: Mapping[str, list[str]], values: Mapping[str, Any]
    ) -> None:
        self.parts = {name: unit(None) for name, unit in units.items()}
        self.links = [(start.split("."), end.split(".")) for start, ends in connections.items() for end in ends]
        for name, each in values.items():
            for variable, value in each.items():
                self.set(name, variable, value)

    def set(self, name: str, variable: str, value: Any) -> None:
        """Set a variable, or an element of one."""
        group, _, index = variable.partition("[")
        part, array = self.parts[name], np.array(getattr(self.parts[name], group))
        if array.dtype.kind == "U":  # a choice
            setattr(part, group, part.declared[group].choices[int(value)])
            return
        array[tuple(int(i) - 1 for i in index.rstrip("]").split(",")) if index else ()] = value
        setattr(part, group, array[()])

    def settle(self, names: list[str]) -> None:
        """Calculate the outputs of components from the base to the tip, back, and again to the tip."""
        for name in (*names, *reversed(names), *names):
            self.parts[name].outputs()
            for (start, output), (end, variable) in self.links:
                if start == name and end in self.parts:
                    setattr(self.parts[end], variable, getattr(self.parts[start], output))


def wired(robot: Robot, settings: Mapping[str, Any] | None = None) -> tuple[Wired, SystemFile]:
    apart, values = decomposed(scenario_of(robot), settings)
    names = [name for name in apart.system.parts if name not in ("trajectory", "controller")]
    units = {name: apart.resolved.units[name] for name in names}
    inner = {
        start: [end for end in ends if end.split(".")[0] in units]
        for start, ends in apart.system.connections.items()
        if start.split(".")[0] in units
    }
    return Wired(units, inner, {name: values[name] for name in names}), apart.system


def robot_of(name: str) -> Robot:
    return make_general_chain() if name == "general" else load_robot(name)


def random_desired(n: int, seed: int) -> Desired:
    return Desired(*np.random.default_rng(seed).normal(size=(5, n)))


ARMS = pytest.mark.parametrize(
    "name", ["planar_2dof", *heavy("slider_3dof", "manipulator_6dof", "kr300_6dof", "iiwa_7dof", "general")]
)


@ARMS
@pytest.mark.parametrize("mode", ["vdc", *heavy("inverse")])
def test_the_feedforward_of_joints_and_links_is_that_of_the_arm(name, mode):
    robot, random = robot_of(name), np.random.default_rng(7)
    system, _ = wired(robot, {"feedforward.mode": mode, "feedforward.K_V": 0.3})
    desired, (q, q_dot, kappa_dot) = random_desired(robot.n, 5), random.normal(size=(3, robot.n))
    F_e = random.normal(size=6)
    for i in range(robot.n):
        joint = system.parts[f"feedforward_joint_{i + 1}"]
        for name, value in {**desired._asdict(), "q": q, "q_dot": q_dot, "kappa_dot": kappa_dot}.items():
            setattr(joint, name, value[i])
    system.parts["feedforward_tool"].F_e_d = F_e
    system.settle([name for name in system.parts if name.startswith("feedforward")])
    gains = FeedbackGains(*(np.full(robot.n, value) for value in (1.0, 0.3, 0.0001, 0.05)))
    expected = (
        feedforward_inverse(robot, desired, F_e)
        if mode == "inverse"
        else feedforward_vdc(robot, gains, desired, q, q_dot, kappa_dot, F_e)
    )
    for name, numbers in expected._asdict().items():
        computed = [getattr(system.parts[f"feedforward_joint_{i + 1}"], name) for i in range(robot.n)]
        # the same lines in the same order; a matrix product may sum in another
        np.testing.assert_allclose(computed, numbers, rtol=1e-12, atol=1e-12 * np.abs(numbers).max(), err_msg=name)


@ARMS
def test_the_plant_of_joints_and_links_is_the_arm(name, draw):
    robot, random = robot_of(name), np.random.default_rng(8)
    system, _ = wired(robot)
    for state in draw(robot, 2, seed=9):
        tau, F_e = random.normal(size=robot.n), random.normal(size=6)
        for i in range(robot.n):
            joint = system.parts[f"plant_joint_{i + 1}"]
            joint.store |= {name: getattr(state, name)[i] for name in ("q", "q_dot", "kappa_dot", "tau_s")}
            joint.tau = tau[i]
        system.parts["plant_tool"].F_e = F_e
        names = [name for name in system.parts if name.startswith("plant")]
        system.settle(names)
        joints = [system.parts[name] for name in names if "joint" in name]
        for joint in joints:
            joint.derivatives()
        x = np.concatenate([state.q, state.q_dot, state.kappa_dot, state.tau_s])
        expected = np.split(plant_derivative(robot, x, tau, F_e), 4)
        for name, numbers in zip(("q", "q_dot", "kappa_dot", "tau_s"), expected, strict=True):
            computed = [getattr(joint, f"der_{name}") for joint in joints]
            # elimination along the chain multiplies rounding errors by ratios of masses, up to 1e3 here
            np.testing.assert_allclose(computed, numbers, rtol=1e-11, atol=1e-12 * np.abs(numbers).max(), err_msg=name)
        # virtual power flows: what a joint adds is the power of its motion and of its rotor, what a link takes that of
        # its net force; what is left at the tip goes to the surroundings
        tool = system.parts["plant_tool"]
        for i, (joint, after) in enumerate(zip(joints, [*joints[1:], None], strict=True)):
            z, size = joint_axis(joint.joint_type), np.abs(joint.V_B) @ np.abs(joint.F_B) + abs(joint.P_A)
            rotor = joint.P_A - joint.V_A @ (force_transform(*joint_placement(robot, i, joint.q)) @ joint.F_B)
            assert abs(joint.P_B - joint.P_A - z @ joint.F_B * joint.q_dot + rotor) < 1e-12 * size  # some ten products
            body = robot.body(i)
            net = mass_matrix(*body) @ joint.V_B_dot + bias_force(*body, joint.g_B, joint.V_B)
            leaves = joint.V_B @ tool.p_B if after is None else after.P_A
            assert abs(joint.P_B - leaves - joint.V_B @ net) < 1e-11 * size


@pytest.mark.heavy
def test_springs_start_with_what_hangs_on_them(general):
    robot = replace(general, rotor_coupling=False)
    system, _ = wired(robot, {"plant.F_e[2]": 3.0, "plant.q_0": 0.4})
    names = [name for name in system.parts if name.startswith("plant")]
    joints = [system.parts[name] for name in names if "joint" in name]
    for joint in joints:
        joint.q = joint.q_0
        joint.store |= {"q": joint.q_0, "q_dot": 0.0, "kappa_dot": 0.0, "tau_s": 0.0}
    for _ in joints:  # from the tip to the base, each once what hangs on it is known
        system.settle(names)
        for joint in joints:
            joint.start()
    system.settle(names)
    for joint in joints:
        joint.derivatives()
        assert abs(joint.der_q_dot) < 1e-10  # forces of some 100 N cancel, over inertias of some 1e-2


def test_two_arms_on_one_body_are_a_wiring(planar, draw):
    """What hangs on the torso is the sum of both arms, as the second-arm interface of the one-piece arm has them."""
    robot = replace(planar, rotor_coupling=False)
    parts, connections, values = torso(robot)
    system = Wired({name: package_units()[unit] for name, unit in parts.items()}, connections, values)
    joint, body = system.parts["torso_joint"], system.parts["torso"]
    joint.store |= {"q": 0.3, "q_dot": 0.7, "kappa_dot": 0.7, "tau_s": 5.0}
    states = draw(robot, 2, seed=11)
    for side, state in zip("CD", states, strict=True):
        for i in range(2):
            start = {name: getattr(state, name)[i] for name in ("q", "q_dot", "kappa_dot", "tau_s")}
            system.parts[f"{side}_joint_{i + 1}"].store |= start
    system.settle(list(parts))
    base = moving_base(np.eye(3), body.V_C[3:], np.zeros(6))
    g = body.g_C
    # arms that know that their base moves, as in the second-arm interface; friction is lumped, on the rotors
    turned = replace(robot, gravity=g)
    loads = [articulated(turned, s.q, s.q_dot, s.tau_s, np.zeros(6), None, base, None).arm for s in states]
    inertia = body.robot_of_joint().body(0)
    np.testing.assert_array_equal(body.V_C[:3], 0.0)  # its joint's axis passes through its origin
    M = mass_matrix(*inertia) + sum(M_S for M_S, _ in loads)
    p = bias_force(*inertia, g, body.V_B) + sum(F_S0 for _, F_S0 in loads)
    np.testing.assert_allclose(body.M_B, M, rtol=0, atol=1e-12 * np.abs(M).max())
    np.testing.assert_allclose(body.p_B, p, rtol=0, atol=1e-11 * np.abs(p).max())


def test_what_joints_and_links_do_not_know_is_refused(planar):
    with pytest.raises(UsageError, match="plant: the robot planar_2dof has moving_base, which units of links and"):
        decomposed(scenario_of(replace(planar, moving_base=True)))
    with pytest.raises(UsageError, match="feedforward: the robot planar_2dof has hysteresis"):
        decomposed(scenario_of(replace(planar, hysteresis=True)))
