"""Traces of a unit's methods: one for each choice, names of arguments, fields of the robot, dependencies."""

import math
import re

import numpy as np
import pytest

from tests.compiler.unit.pair import both
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UnitError
from vdfmu.compiler.c.generate import generated_sources
from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import (
    JOINTS,
    Choice,
    Derivative,
    Input,
    Output,
    Parameter,
    RobotParameters,
    Sampled,
    State,
    Switch,
    Unit,
    zeros,
)

EPS = np.finfo(float).eps


class Chosen(Unit):
    """Two choices in the outputs, one of them in one branch alone; one in the derivatives."""

    u = Input("1", 3)
    mode = Choice("a", "b", "c")
    doubled = Switch(False)
    k = Parameter("1", start=5.0)
    x = State("1")
    x_dot = Derivative(x)
    y = Output("1", 3)

    def __init__(self, *arguments, **values):
        self.sign = -1.0  # before there are values
        super().__init__(*arguments, **values)

    def outputs(self) -> None:
        if self.mode == "a":
            self.y = self.u
        elif self.mode == "b":
            self.y = 2.0 * self.u if self.doubled else self.sign * self.u
        else:
            self.y = self.k

    def derivatives(self) -> None:
        self.x_dot = self.u[0] if self.doubled else self.k * self.x


@pytest.mark.parametrize("mode", range(3))
@pytest.mark.parametrize("doubled", [0, 1])
def test_a_choice_in_the_memory_decides(mode, doubled):
    for unit in both(Chosen):
        unit.group("mode")[:], unit.group("doubled")[:], unit.group("u")[:] = mode, doubled, [1.0, 2.0, 3.0]
        unit.x[:] = 2.0
        unit.outputs()
        unit.derivatives()
        factor = {0: 1.0, 1: 2.0 if doubled else -1.0}.get(mode)
        expected = [5.0] * 3 if factor is None else [factor, 2.0 * factor, 3.0 * factor]
        assert unit.group("y").tolist() == expected
        assert unit.x_dot.tolist() == [1.0 if doubled else 10.0]


class Incomplete(Unit):
    """Sets y in one mode alone."""

    u = Input("1")
    mode = Choice("a", "b")
    y = Output("1")

    def outputs(self) -> None:
        if self.mode == "a":
            self.y = self.u


def test_an_output_that_is_not_set_for_a_choice_is_named():
    with pytest.raises(UnitError, match=r"line \d+: outputs\(\) of Incomplete never sets y with mode = b\."):
        _ = Interface(Incomplete, None).program


class Clashing(Unit):
    """Variables called as the arguments of traced functions, and as words of C, are."""

    p = Input("Pa")
    x = State("m", start=1.0)
    v = State("m/s", start=2.0)
    x_dot = Derivative(x)
    v_dot = Derivative(v)
    h = Parameter("s", start=3.0)
    w1 = Parameter("1", start=0.5)
    rate_p = Input("1")
    sin = Sampled("1", start=0.25)
    period = Parameter("s", start=0.1, minimum=1e-6)
    double = Output("1")
    norm = Output("1")

    def outputs(self) -> None:
        self.double = self.x + 10.0 * self.v + 100.0 * self.p + 1000.0 * self.h + self.w1
        self.norm = self.sin

    def derivatives(self) -> None:
        self.x_dot = self.v + self.w1 + self.rate_p
        self.v_dot = -self.x + self.p + 0.0 * self.tolerance

    def update(self) -> None:
        self.sin = self.sin + np.sin(self.x)


def test_a_variable_may_be_called_as_an_argument_is_and_keeps_what_an_array_was():
    for unit in both(Clashing):
        unit.group("p")[:], unit.group("rate_p")[:] = 5.0, 7.0
        unit.start()
        unit.outputs()
        unit.derivatives()
        unit.update()
        assert unit.x.tolist() == [1.0, 2.0] and unit.x_dot.tolist() == [9.5, 4.0]
        assert unit.group("double").tolist() == [1.0 + 20.0 + 500.0 + 3000.0 + 0.5]
        assert unit.group("norm").tolist() == [0.25]
        assert unit.group("sin").tolist() == [pytest.approx(0.25 + math.sin(1.0), rel=EPS)]
    for unit in both(Reused):
        unit.group("u")[:] = 3.0
        unit.outputs()
        assert (unit.group("y").tolist(), unit.group("z").tolist()) == ([3.0, 0.0], [3.0, 5.0])
    for kind in (Traced, Plain):
        with pytest.raises(UnitError, match=r"line \d+: outputs\(\) of Touched fails: an element of a variable"):
            kind(Interface(Touched, None)).outputs()


class Geared(Unit):
    """Takes one field of the robot."""

    tau = Input("N.m", JOINTS)
    y = Output("N.m", JOINTS)
    robot = RobotParameters("ell")

    def outputs(self) -> None:
        self.y = self.robot.ell * self.tau


class Undeclared(Geared):
    """Takes another one than it declares."""

    def outputs(self) -> None:
        self.y = self.robot.mass * self.tau


class Reused(Unit):
    """Sets two outputs to one array, which it changes in between."""

    u = Input("1")
    y = Output("1", 2)
    z = Output("1", 2)

    def outputs(self) -> None:
        array = zeros((2,), self.u)
        array[0] = self.u
        self.y = array
        array[1] = 5.0
        self.z = array


class Touched(Unit):
    """Changes an element of a parameter that has its start value."""

    K = Parameter("1", 2, start=[1.0, 2.0])
    y = Output("1", 2)

    def outputs(self) -> None:
        self.K[0] = 7.0
        self.y = self.K


class ManyWays(Unit):
    """Has a step of the solver for each choice."""

    way = Choice(*"fcbead")
    x = State("1")
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        self.x_dot = -self.x if self.way == "a" else self.x


def test_generated_files_have_the_order_of_names_whatever_python_makes_of_texts():
    header = generated_sources(Interface(ManyWays, None), "{}")["kernel.h"]
    listed = re.findall(r"many_ways_step_\w_avx2", header)
    assert listed == sorted(listed) and len(listed) == 6


def test_a_field_of_the_robot_is_a_parameter_and_dependencies_are_those_of_the_trace():
    robot = load_robot("planar_2dof")
    for unit in both(Geared, robot):
        unit.group("tau")[:], unit.group("ell")[1] = [1.0, 2.0], 50.0
        unit.outputs()
        assert unit.group("y").tolist() == [robot.ell[0], 100.0]
    with pytest.raises(UnitError, match=r"declares no mass of the robot\. Write RobotParameters\('ell', 'mass'\)"):
        _ = Interface(Undeclared, robot).program
    interface = Interface(Chosen, None)
    at = interface.reference
    assert interface.step_dependencies(at["y[2]"]) == [at["u[2]"]]
    assert interface.step_dependencies(at["x"]) == [at["x"]]
    assert interface.step_dependencies(len(interface)) == [at["u[1]"], at["x"]]
    assert interface.start_dependencies(at["x"]) == [at["x_0"]]
    assert {at["mode"], at["doubled"], at["k"], at["u[2]"]} == set(interface.start_dependencies(at["y[2]"]))
