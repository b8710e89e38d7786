"""What a unit declares: shapes, units of measurement, order, start values, added parameters, and names."""

import numpy as np
import pytest

from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.measure import derivative_of, measure, unit_of
from vdfmu.compiler.unit.declaration_check import check_unit
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
    Terminal,
    Unit,
)


class Many(Unit):
    """One of each kind. The rest of the docstring is for the page."""

    k = Parameter("N/m", text="stiffness", start=3.0, minimum=1.0, maximum=5.0)
    y = Output("torque", JOINTS, "torque")
    s = Sampled("velocity", JOINTS, "sampled velocity", start=0.5)
    period = Parameter("s", start=1e-3, minimum=1e-6)
    q = State("position", JOINTS, "position", start=lambda robot: 0.1 * np.arange(robot.n))
    q_dot = Derivative(q)
    mode = Choice("slow", "fast", text="mode")
    on = Switch(True, "on")
    u = Input(("N", "N.m"), 2, ("a force", "a moment"))
    M = Parameter("1", (2, 2), "matrix", start=np.eye(2))
    g = Parameter("1", JOINTS, "gain", start=2.0, tunable=True)
    robot = RobotParameters("ell")

    def outputs(self) -> None:
        self.y = self.g * self.q

    def derivatives(self) -> None:
        self.q_dot = -self.q


SLIDER = load_robot("slider_3dof")
"""A robot with a prismatic joint, the second."""


@pytest.fixture
def many():
    return Interface(Many, SLIDER)


def test_variables_stand_in_the_order_of_their_kinds_with_shapes_and_units_of_measurement_of_the_joints(many):
    assert list(many.groups) == [
        "u", "q", "s", "y", "k", "period", "mode", "on", "M", "g", "s_0", "q_0", "tolerance", "solver", "ell",
    ]  # fmt: skip
    # behind the variables the derivatives of the continuous states, and the time
    assert [v.name for v in many.memory[len(many) :]] == ["der(q[1])", "der(q[2])", "der(q[3])", "time"]
    assert many.states == many.groups["q"]
    assert [v.name for v in many if v.group == "M"] == ["M[1,1]", "M[1,2]", "M[2,1]", "M[2,2]"]
    units = {v.name: v.unit for v in many.memory}
    for name, expected in {"q": ["rad", "m", "rad"], "y": ["N.m", "N", "N.m"], "u": ["N", "N.m"]}.items():
        assert [units[f"{name}[{i}]"] for i in range(1, len(expected) + 1)] == expected
    assert units["der(q[2])"] == "m/s" and units["mode"] is None


def test_descriptions_name_the_joint_or_the_indices_and_start_values_are_broadcast_or_come_from_the_robot(many):
    texts = {v.name: v.description for v in many.memory}
    assert [texts[name] for name in ("q[2]", "q_0[2]", "der(q[2])", "u[2]", "M[2,1]", "k")] == [
        "Joint 2: position", "Joint 2: start of position", "Joint 2: derivative of the position", "a moment",
        "Matrix, row 2, column 1", "Stiffness",
    ]  # fmt: skip
    bare = type("Bare", (Unit,), {"x": State("m", 2), "v": State("m/s", text="speed")})
    bare = type("Derived", (bare,), {"x_dot": Derivative(bare.x), "v_dot": Derivative(bare.v)})
    texts = {v.name: v.description for v in Interface(bare, None).memory}
    assert (texts["x[1]"], texts["x_0[1]"], texts["der(x[2])"]) == ("", "Start of x 1", "Derivative of x 2")
    assert many.description == "One of each kind. The rest of the docstring is for the page"
    starts = {group: [v.start for v in many if v.group == group] for group in many.groups}
    assert (starts["q_0"], starts["s_0"], starts["M"]) == ([0.0, 0.1, 0.2], [0.5] * 3, [1.0, 0.0, 0.0, 1.0])
    assert (starts["mode"], starts["on"], starts["y"]) == ([0], [True], [None] * 3)
    assert starts["ell"] == many.robot.ell.tolist()
    kinds = {v.group: (v.type, v.variability) for v in many}
    assert [kinds[name] for name in ("k", "g", "q", "s", "mode", "on")] == [
        ("Real", "fixed"), ("Real", "tunable"), ("Real", "continuous"), ("Real", "discrete"), ("Integer", "fixed"),
        ("Boolean", "fixed"),
    ]  # fmt: skip
    mode = many.find("mode")
    assert mode.choices == ("slow", "fast") and (mode.minimum, mode.maximum) == (0, 1)
    assert (many.find("k").minimum, many.find("k").maximum) == (1.0, 5.0)


def test_a_unit_without_start_gets_a_parameter_for_each_state_and_a_tolerance(many):
    assert many.find("q_0[1]").causality == "parameter"
    tolerance = many.find("tolerance")
    assert (tolerance.start, tolerance.minimum, tolerance.maximum) == (1e-7, 1e-12, 1e-1)

    class Started(Unit):
        x = State("m")
        x_dot = Derivative(x)
        begin = Parameter("m", start=4.0)

        def start(self) -> None:
            self.x = 2.0 * self.begin

    assert list(Started.declared) == ["x", "x_dot", "begin", "tolerance", "solver"]

    class OnlySampled(Unit):  # needs no solver
        x = Sampled("m")
        period = Parameter("s", start=1e-3, minimum=1e-6)

    assert list(OnlySampled.declared) == ["x", "period", "x_0"]
    assert not Interface(OnlySampled, None).has_states and Interface(OnlySampled, None).is_sampled


def test_declared_start_parameters_keep_their_start_and_a_subclass_has_those_of_its_base():
    x_0 = Parameter("m", text="of my own", start=7.0)
    parent = type("Own", (Unit,), {"x": (x := State("m", start=1.0)), "x_dot": Derivative(x), "x_0": x_0})
    assert parent.declared["x_0"].text == "of my own"
    assert Interface(type("Moving", (parent,), {"derivatives": lambda self: None}), None).find("x_0").start == 7.0
    base = type("Base", (Unit,), {"u": Input("1")})
    more = type("More", (base,), {"y": Output("1")})
    assert list(more.declared) == ["u", "y"] and list(base.declared) == ["u"]


REFUSED_NAMES = {
    "a variable cannot be called {}: every unit has it": [
        "t", "n", "start", "outputs", "store", "declared", "balance", "of_robot",
    ],
    "a variable cannot be called {}: expected a letter, then": ["_u", "u__2", "time", "\u03c4"],
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED_NAMES)
def test_names_that_are_taken_or_that_tools_and_c_cannot_take_are_refused(words):
    for name in REFUSED_NAMES[words]:
        with pytest.raises(UnitError, match=f"Bad: {words.format(name)}"):
            Interface(type("Bad", (Unit,), {name: Input("1")}), None)
    for name in ("_Gain", "My__Gain", "Gain_", "Größe"):
        with pytest.raises(UnitError, match=f"a unit cannot be named {name}: expected a letter, then letters, digits"):
            Interface(type(name, (Unit,), {"u": Input("1")}), None)


def test_a_unit_with_joints_needs_a_robot_and_its_instance_has_values():
    with pytest.raises(UnitError, match="Many needs a robot, for its joints"):
        Many()
    with pytest.raises(UnitError, match="Many needs a robot"):
        Interface(Many, None)
    assert not type("Free", (Unit,), {"u": Input("1", 3)}).needs_robot()
    unit = Many(SLIDER, k=4.0, g=[1.0, 2.0, 3.0], mode="fast")
    unit.start()
    unit.q = [1.0, 2.0, 3.0]
    unit.outputs()
    assert unit.y.tolist() == [1.0, 4.0, 9.0]
    assert (unit.k, unit.mode, unit.on, unit.n) == (4.0, "fast", True, 3)
    gains = np.ones(3)
    unit.g = gains
    gains[0] = 2.0
    assert unit.g.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(UnitError, match=r"Many\.y is read before it is set"):
        _ = Many(SLIDER).y


@pytest.mark.parametrize(("name", "value", "words"), [
    ("K", 1.0, r" has no 'K' to set\. There are: k, period, mode"),
    ("g", [1.0, 2.0], r"\.g: expected shape \(3,\), got \(2,\)"),
    ("mode", "quick", r"\.mode: expected slow or fast, got 'quick'"),
    ("on", 0.5, r"\.on: expected True or False, got 0\.5"),
    ("k", "stiff", r"\.k: expected numbers, got 'stiff'"),
    ("k", None, r"\.k: expected numbers, got None"),
])  # fmt: skip
def test_an_instance_refuses_other_values(name, value, words):
    with pytest.raises(UsageError, match=f"Many{words}"):
        Many(SLIDER, **{name: value})


def test_start_values_of_an_interface_are_checked_and_the_experiment_keeps_inputs_within_their_limits():
    for values, words in (
        ({"k": 7.0, "y[1]": 1.0}, r"k: expected at most 5 N/m, got 7 N/m\. y\[1\] is an output"),  # all at once
        ({"on": 0.5}, "on: expected true or false, got 0.5"),
    ):
        with pytest.raises(UsageError, match=f"start values of many: {words}"):
            Interface(Many, SLIDER, values)
    changed = Interface(Many, SLIDER, {"mode": 1, "on": False, "g[2]": 5})
    assert [changed.find(name).start for name in ("mode", "on", "g[2]")] == [1, False, 5.0]
    with pytest.raises(UnitError, match=r"g: start value: expected shape \(3,\), got \(2,\)"):
        type("Bad", (Unit,), {"g": Parameter("1", JOINTS, start=[1.0, 2.0])})(SLIDER)
    unit = type("Narrow", (Unit,), {"u": Input("1", 2, start=3.0, minimum=2.0, maximum=4.0), "v": Input("1")})()
    unit.t = 1.0
    unit.experiment()
    assert unit.u.tolist() == [2.0, 2.0] and unit.v == 0.1 * np.sin(3.0)


ONE_EACH = "expected parameters with one number for each"


@pytest.mark.parametrize(("declared", "words"), [
    *(
        ({"robot": RobotParameters(n)}, rf"RobotParameters\('{n}'\): {ONE_EACH}")
        for n in ("rotation", "gravity", "mas")
    ),
    ({"u": Input("1", when="pyload")}, r"u: when: expected one of payload, limits, .*, got 'pyload'"),
    ({"g": Parameter("1", JOINTS, start=[1.0, 2.0])}, r"Bad: g: start: expected numbers of shape \(3,\), got \[1"),
])  # fmt: skip
def test_declarations_that_do_not_fit_the_robot_are_refused(declared, words):
    with pytest.raises(UnitError, match=words):
        Interface(type("Bad", (Unit,), declared), SLIDER)


@pytest.mark.parametrize(("name", "exponents"), [
    ("1", {}), ("N.m", {"kg": 1, "m": 2, "s": -2}), ("m/s2", {"m": 1, "s": -2}), ("kg.m2", {"kg": 1, "m": 2}),
    ("1/(N.m)", {"kg": -1, "m": -2, "s": 2}), ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
    ("V.s/m", {"kg": 1, "m": 1, "s": -2, "A": -1}), ("s-1", {"s": -1}), ("m/m", {}),
    ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}),
])  # fmt: skip
def test_a_unit_of_measurement_has_the_exponents_of_its_factors(name, exponents):
    assert measure(name).exponents == exponents
    assert measure(name).name == name


@pytest.mark.parametrize("name", ["", "furlong", "N m", "m/", "m/s/s", "N..m", "mm", "deg", "/s", "m^2", "1/()"])
def test_what_is_not_a_unit_of_measurement_is_refused(name):
    with pytest.raises(UsageError, match="expected a unit of measurement such as N.m, .* The symbols are kg, m, s"):
        measure(name)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("rad", "rad/s"), ("rad/s", "rad/s2"), ("m/s2", "m/s3"), ("N.m", "N.m/s"), ("1/(N.m)", "1/(N.m.s)"),
     ("N/m", "N/(m.s)"), ("1", "1/s"), ("N.m.s/rad", "N.m.s/(rad.s)")],
)  # fmt: skip
def test_the_derivative_has_one_second_more(name, expected):
    assert derivative_of(name) == expected
    before, after = measure(name).exponents, measure(expected).exponents
    seconds = {"s": before.get("s", 0) - 1}
    assert after == {key: value for key, value in (before | seconds).items() if value}


def test_a_quantity_of_a_joint_has_two_units_and_a_unit_of_measurement_one_for_displays():
    for quantity, units in (("torque", ["N.m", "N"]), ("N.m", ["N.m", "N.m"])):
        assert [unit_of(quantity, kind) for kind in ("revolute", "prismatic")] == units
    with pytest.raises(UsageError, match="got 'torqe'"):
        unit_of("torqe", "revolute")
    assert measure("rad").display == {"deg": pytest.approx(57.29577951308232)}
    assert measure("V").display == {}


class Wrong(Unit):
    """Declares what would fail without a word of where."""

    backend = "Python"  # pyright: ignore
    terminals = (Terminal("flange", "middle", ("y", "zz"), "flange"),)  # pyright: ignore
    y = Output("1")
    z = Output(1.0)  # pyright: ignore
    w = Output("1", 2, [1, 2])  # pyright: ignore
    low = Parameter("1", minimum="a")  # pyright: ignore
    lost = Parameter("1", start=lambda robot: robot.mass)
    on = Switch("on")  # pyright: ignore
    mode = Choice("a", 2)  # pyright: ignore


def test_declarations_of_other_types_are_named_all_at_once():
    with pytest.raises(UnitError) as raised:
        check_unit(Wrong, None)
    lines = str(raised.value).splitlines()
    expected = (
        'Wrong: backend: expected "native" or "python", got \'Python\'.',
        "Wrong: terminal flange: expected variables of the unit, got zz.",
        "Wrong: terminal flange: expected the side left, right, bottom or top, got 'middle'.",
        "Wrong: z: expected units of measurement, one or one for each element, got 1.0.",
        "Wrong: w: expected texts, one or one for each element, got [1, 2].",
        "Wrong: low: minimum: expected a number, got 'a'.",
        "Wrong: lost: start: the function fails for no robot: AttributeError: 'NoneType' object has no attribute",
        "Wrong: on: expected True or False, got 'on'.",
        "Wrong: mode: expected choices that are texts, got ('a', 2).",
    )
    for line, words in zip(lines, expected, strict=True):
        assert words in line
        assert "test_declaration.py, line " in line


class Loaded(Unit):
    """What it has depends on the robot."""

    u = Input("N", text="force", when="payload")
    y = Output("1", text="always")
    x = State("1", JOINTS, "of each joint", when="hysteresis")
    x_dot = Derivative(x)

    def outputs(self) -> None:
        self.y = 1.0 if not self.of_robot.payload else self.u

    def derivatives(self) -> None:
        if self.of_robot.hysteresis:
            self.x_dot = -self.x


def test_a_unit_has_the_variables_of_the_options_that_its_robot_has(with_options):
    bare, bent = Interface(Loaded, SLIDER), Interface(Loaded, with_options("hysteresis"))
    assert list(bare.groups) == ["y", "tolerance", "solver"]
    assert (bare.states, bare.derivatives, len(bare.memory)) == (slice(3, 3), slice(3, 3), 4)
    assert list(bent.groups) == ["x", "y", "x_0", "tolerance", "solver"]
    assert [v.name for v in bent.memory[bent.derivatives]] == ["der(x[1])", "der(x[2])"]
    assert Loaded(with_options("hysteresis"), x_0=2.0).simulate(stop=1.0)["x"][-1] == pytest.approx(2.0 / np.e)
    assert Loaded(SLIDER).simulate(stop=0.1)["y"][-1] == 1.0
    with pytest.raises(UnitError, match=r"Loaded\.u exists only for a robot with payload"):
        _ = Loaded(SLIDER).u
    with pytest.raises(UsageError, match="Loaded has no 'x_0' to set"):
        Loaded(SLIDER, x_0=1.0)
