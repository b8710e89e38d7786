"""Declared dependencies are true: an output changes if, and only if, what it is said to depend on changes."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.compiler.native.binding import doubles, references
from tests.compiler.points import POINTS, SWITCHES, random_value
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.interface import Interface

Opener = Callable[..., Any]


class Probe:
    """A unit in initialization mode, at a random point that can be moved in single variables."""

    def __init__(self, unit: Any, interface: Interface, **choices: Any) -> None:
        self.unit, self.interface = unit, interface
        self.outputs = [i for i, v in enumerate(interface) if v.causality == "output"]
        rng = np.random.default_rng(1)
        self.point = {
            i: random_value(v.group, v.causality, v.start, v.minimum is not None, rng)
            for i, v in enumerate(interface)
            if v.causality != "output" and v.type == "Real"
        }
        for group, value in choices.items():
            if group in SWITCHES[interface.name]:
                unit.set(**{group: value})
            else:
                where = interface.groups[group]
                self.point |= dict.fromkeys(range(where.start, where.stop), value)
        self.set(self.point)

    def set(self, values: dict[int, float]) -> None:
        """Set variables by value reference."""
        self.unit.do("SetReal", references([*values]), len(values), doubles([*values.values()]))

    def values(self) -> np.ndarray:
        """All outputs."""
        return self.unit.outputs()

    def move(self, reference: int) -> tuple[np.ndarray, np.ndarray]:
        """Change one variable by 1 %, and back; return the outputs before and after."""
        before = self.values()
        self.set({reference: 1.01 * self.point[reference]})
        after = self.values()
        self.set({reference: self.point[reference]})
        assert np.array_equal(self.values(), before)  # nothing remembers the move
        return before, after


def probes(open_unit: Opener, interface: Interface) -> Iterator[Probe]:
    for choices in POINTS[interface.name]:
        yield Probe(open_unit(interface.name, interface.robot.name).setup().enter(), interface, **choices)


Pairs = set[tuple[str, str]]
FORMS = pytest.mark.parametrize("version", ["2.0", "python"])
"""Those of FMI 3.0 are arrays, held against these in native/test_derivatives.py."""


def declared(interface: Interface, dependencies: Callable[[int], list[int]]) -> Pairs:
    return {
        (v.name, interface.memory[k].name)
        for i, v in enumerate(interface)
        if v.causality == "output"
        for k in dependencies(i)
        if interface.memory[k].causality in ("input", "parameter")
    }


def cancels(robot: str, unit: str, output: str, source: str) -> bool:
    """Whether a dependency cancels exactly: the equations have it, the physics of this geometry has not."""
    group = source.split("[")[0]
    if output.startswith("kappa_dot_d[") and source == "mode":
        return True  # both modes take it from the desired motion
    if robot == "slider_3dof" and unit == "feedforward":
        # Axis 3 is horizontal: the inertia about it, and what its rotor does as its spring winds up, have no torque
        # about axis 1, which is vertical.
        of_axis_3 = ("inertia[3,3,3]", "F_e_d[6]", "I_m[3]", "ell[3]", "K_f0[3]", "K_w0[3]", "c_f[3]", "c_w[3]")
        return output[-3:] == "[1]" and source in of_axis_3
    if robot == "slider_3dof":
        # Axis 1 is vertical: heights do not depend on q_1, nor on the arm's length.
        return (output, source) in {("E_pot", "q_0[1]"), ("E_pot", "offset[2,1]")}
    if robot == "manipulator_6dof":
        # Axis 1 is vertical: gravity exerts no torque about it. Axes 2 and 3 stay horizontal: inertias about them
        # do not load it. The centre of mass of link 6 lies on axis 6: its height does not depend on q_6.
        if unit == "feedforward":
            return output[-3:] == "[1]" and source in ("inertia[2,3,3]", "inertia[3,3,3]", "gravity[3]")
        if output in ("tau_s[1]", "kappa[1]"):
            return group in ("gravity", "centroid", "mass")
        return (output, source) == ("E_pot", "q_0[6]")
    return False


@pytest.mark.few(2)
@FORMS
def test_initial_dependencies_are_exactly_what_outputs_change_with(open_unit, interface):
    """For every single output and variable: to the bit where it is not declared, clearly where it is."""
    changed: Pairs = set()  # in any bit
    moved: Pairs = set()  # by more than rounding
    for probe in probes(open_unit, interface):
        for reference in probe.point:
            before, after = probe.move(reference)
            source = interface.variables[reference].name
            # Between rounding, seen up to 9e-16 of the output, and the least effect of 1 %, seen as 3e-12.
            for k, old, new in zip(probe.outputs, before, after, strict=True):
                if new != old:
                    changed.add((interface.variables[k].name, source))
                if abs(new - old) > 4e-14 * (1.0 + abs(old)):
                    moved.add((interface.variables[k].name, source))
    for name, settings in SWITCHES[interface.name].items():
        probe = next(probes(open_unit, interface))
        before, after = (probe.unit.set(**{name: s}) and probe.values() for s in settings)
        moved |= {(interface.variables[probe.outputs[k]].name, name) for k in np.flatnonzero(before != after)}
    expected = declared(interface, interface.start_dependencies)
    assert changed <= expected
    hidden = {
        (output, source) for output, source in expected if cancels(interface.robot.name, interface.name, output, source)
    }
    assert sorted(expected - hidden - moved) == []
    assert sorted(moved & hidden) == []


@pytest.mark.heavy
@FORMS
def test_direct_dependencies_are_exactly_what_outputs_change_with_at_a_step(open_unit, interface):
    """At a communication point: the outputs that doStep leaves, for inputs that were set just before it."""
    if interface.name in ("plant", "trajectory"):  # a state decides, or time alone
        assert declared(interface, interface.step_dependencies) == set()
        return
    changed: Pairs = set()
    for probe in probes(open_unit, interface):
        probe.unit.do("ExitInitializationMode")
        before = probe.unit.step() and probe.values()
        for reference in (i for i in probe.point if interface.variables[i].causality == "input"):
            probe.set({reference: 1.01 * probe.point[reference]})
            after = probe.unit.step() and probe.values()
            probe.set({reference: probe.point[reference]})
            names = [interface.variables[probe.outputs[k]].name for k in np.flatnonzero(before != after)]
            changed |= {(name, interface.variables[reference].name) for name in names}
    expected = declared(interface, interface.step_dependencies)
    assert changed <= expected
    assert {pair for pair in expected - changed if not cancels(interface.robot.name, interface.name, *pair)} == set()


@FORMS
def test_torques_do_not_move_the_plant_before_its_step_nor_its_start(open_unit, robot_name):
    unit = open_unit("plant", robot_name).start(tau=0.01)
    before = unit.step().outputs()
    unit.set(tau=1.0, F_e=10.0)
    assert np.array_equal(unit.outputs(), before)
    assert not np.array_equal(unit.step().outputs(), before)
    unit = open_unit("plant").setup().enter()
    before = unit.outputs()
    assert np.array_equal(unit.set(tau=5.0).outputs(), before)


@FORMS
def test_the_plant_stays_at_rest_under_the_wrench_that_it_starts_with(open_unit, robots, robot_name):
    """Set before or in initialization mode; the motors hold the springs, as friction is 0 at rest."""
    robot = robots[robot_name]
    q_0, F_e = np.linspace(-0.5, 0.4, robot.n), np.array([20.0, -10.0, 30.0, 1.0, 2.0, -1.5])
    for early in (True, False):
        unit = open_unit("plant", robot_name).set(q_0=q_0).setup()
        if early:
            unit.set(F_e=F_e)
        unit.enter()
        before = unit.get("tau_s")
        unit.set(F_e=F_e)
        tau_s = unit.get("tau_s")
        assert np.array_equal(tau_s, before) is early
        unit.do("ExitInitializationMode")
        for _ in range(5):
            unit.step(0.01, tau=tau_s / robot.ell)
        # Roundings of torques of up to 100 N m, through stiffnesses of 1e3 and more and inertias of 1e-3 kg m2.
        np.testing.assert_allclose(unit.get("q"), q_0, rtol=0, atol=1e-11)
        np.testing.assert_allclose(unit.get("tau_s"), tau_s, rtol=0, atol=1e-8)


def test_the_gravity_torque_of_a_joint_needs_only_the_links_that_it_carries(planar):
    """By hand for the planar arm: G2 = m2 b g cos(q1 + q2) (the robot's file), and x f_y + m_z of the wrench."""
    interface = Interface(shipped_units()["plant"], planar)
    names = {interface.variables[i].name for i in interface.start_dependencies(interface.reference["tau_s[2]"])}
    assert names == {
        "q_0[1]", "q_0[2]", "equilibrium", "tau_s_0[2]", "gravity[3]", "centroid[2,1]", "mass[2]",
        "tool_offset[1]", "F_e[2]", "F_e[6]",
    }  # fmt: skip
