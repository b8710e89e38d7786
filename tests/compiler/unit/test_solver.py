"""The solver's step of any unit, its Jacobian, and sampled states: against closed forms and differences."""

import numpy as np
import pytest

from benchmarks.chains import repeated_link
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import KernelError, UnitError
from vdfmu.compiler.functions.rodas import ORDER
from vdfmu.compiler.unit.declaration import SOLVERS
from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import Integrator, ScipySolver, samples
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
    Unit,
    where,
)

EPS = np.finfo(float).eps


class Logistic(Unit):
    """Grows to its capacity: x = 1 / (1 + 9 exp(-t)) from 0.1."""

    x = State("1", start=0.1)
    x_rate = Derivative(x)

    def derivatives(self) -> None:
        self.x_rate = self.x * (1.0 - self.x)


class Fading(Unit):
    """Depends on the time: x = 1 / (1 + t^2) from 1."""

    x = State("1", start=1.0)
    x_rate = Derivative(x)

    def derivatives(self) -> None:
        self.x_rate = -2.0 * self.t * self.x**2


class Chosen(Unit):
    """Two states whose order and whose rate depend on choices: x = exp(-k t) or x = 1 / (1 + k t)."""

    law = Choice("linear", "square")
    k = Parameter("1/s", start=2.0)
    x = State("1", start=1.0)
    y = State("1", 2, start=[1.0, -1.0])
    y_rate = Derivative(y)
    x_rate = Derivative(x)

    def derivatives(self) -> None:
        self.x_rate = -self.k * (self.x if self.law == "linear" else self.x**2)
        self.y_rate = self.x * self.y[::-1]


class Ramp(Unit):
    """Follows its input: with u = t, x = t - T (1 - exp(-t / T))."""

    u = Input("1")
    T = Parameter("s", start=0.5)
    x = State("1")
    x_rate = Derivative(x)

    def derivatives(self) -> None:
        self.x_rate = (self.u - self.x) / self.T


def solver_of(unit, tolerance=1e-9, robot=None, **values):
    evaluated = Traced(Interface(unit, robot))
    for name, value in values.items():
        evaluated.group(name)[:] = value
    evaluated.start()
    solver = Integrator(evaluated)
    solver.tolerance = tolerance
    return solver


def stepped(unit, end, steps, rates=None, **values):
    evaluated = solver_of(unit, **values).unit
    (call,) = (
        c for c in evaluated.interface.program.step
        if all(evaluated.group(name)[0] == value for name, value in c.when)
    )  # fmt: skip
    functions = evaluated.interface.functions
    names = functions.casadi_function(call.function).name_in()
    args = {name: evaluated.argument(name) for name in names if name not in ("h", "tolerance") and "rate_" not in name}
    step = functions.function(call.function, **args)
    h = end / steps
    step.args["h"][:], step.args["tolerance"][:] = h, 1.0
    for name, rate in (rates or {}).items():
        step.args[f"rate_{name}"][:] = rate
    for k in range(steps):
        evaluated.memory[-1] = k * h
        for name, rate in (rates or {}).items():
            evaluated.group(name)[:] = k * h * rate
        step.run()
        evaluated.x[:] = step.results["x_new"]
    return evaluated.x.copy()


CASES = [
    (Logistic, {}, 4.0, 1.0 / (1.0 + 9.0 * np.exp(-4.0))), (Fading, {}, 2.0, 0.2),
    (Chosen, {"law": 0}, 1.0, np.exp(-2.0)), (Chosen, {"law": 1}, 1.0, 1.0 / 3.0),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "values", "end", "exact"), CASES)
def test_a_step_has_order_four_on_any_unit_and_the_solver_keeps_its_tolerance(unit, values, end, exact):
    errors = [abs(stepped(unit, end, n, **values)[0] - exact) for n in (64, 128, 256)]
    assert errors[-1] > 1e-13  # above rounding
    # The next term of the error is smaller by the step, 1/64 and less: the last pair shows the order to 0.1.
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(ORDER, abs=0.1)
    solver = solver_of(unit, 1e-9, **values)
    solver.advance(0.0, end)
    assert solver.x[0] == pytest.approx(exact, abs=1e-7)  # 100 local errors of 1e-9
    if unit is Chosen:  # y_1 + y_2 is kept at 0: the difference of the two is decided by the same x
        assert solver.x[1] == pytest.approx(-solver.x[2], abs=1e-12)


@pytest.mark.parametrize(("unit", "values", "end", "exact"), CASES)
@pytest.mark.parametrize("kind", [Traced, Plain])
def test_scipy_on_either_evaluation_gives_the_closed_form(unit, values, end, exact, kind):
    evaluated = kind(Interface(unit, None))
    for name, value in values.items():
        evaluated.group(name)[:] = value
    evaluated.start()
    solver = ScipySolver(evaluated)
    solver.move(0.0, end)
    solver.advance(end, 0.0)  # no time: no change
    # tolerance 1e-12 of each step, some hundred steps
    assert evaluated.x[0] == pytest.approx(exact, abs=1e-9)


def test_a_step_takes_inputs_as_lines():
    T, end = 0.5, 1.0
    exact = end - T * (1.0 - np.exp(-end / T))
    errors = [abs(stepped(Ramp, end, n, {"u": 1.0})[0] - exact) for n in (8, 16, 32)]
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(ORDER, abs=0.2)  # as above, steps of 1/16 of T
    held = abs(stepped(Ramp, end, 32)[0])
    assert held == 0.0  # without a rate the input of 0 is held


class Coupled(Unit):
    """Nonlinear in everything, for its Jacobian."""

    u = Input("1", JOINTS)
    a = State("1", JOINTS, start=0.3)
    b = State("1", start=-0.2)
    a_rate = Derivative(a)
    b_rate = Derivative(b)
    robot = RobotParameters("ell")

    def derivatives(self) -> None:
        self.a_rate = np.sin(self.a[::-1]) * self.b + self.u / self.robot.ell
        self.b_rate = where(self.b < 0.0, self.a @ self.u, self.b) - self.b**3


def jacobian_of(unit, robot):
    evaluated = Traced(Interface(unit, robot))
    random = evaluated.memory[: evaluated.interface.groups["tolerance"].start]
    random[:] = np.random.default_rng(91).uniform(-0.5, 0.5, random.size)
    name, functions = f"{evaluated.interface.name}_jacobian", evaluated.interface.functions
    names = functions.casadi_function(name).name_in()
    function = functions.function(name, **{n: evaluated.argument(n) for n in names})
    function.run()
    m = evaluated.x.size
    return function.results["J"].reshape(m, m, order="F"), evaluated


def test_the_jacobian_of_any_unit_agrees_with_differences_and_that_from_the_balance():
    J, evaluated = jacobian_of(Coupled, load_robot("slider_3dof"))
    x = evaluated.x.copy()
    for j in range(len(x)):
        step = 1e-5 * np.eye(len(x))[j]
        high, low = (evaluated.rate(0.0, x + s * step) for s in (1.0, -1.0))
        # Rounding 1e-16 / 1e-5; truncation h^2 / 6 times a third derivative of up to 6.
        np.testing.assert_allclose(J[:, j], (high - low) / 2e-5, rtol=0, atol=2e-10)

    class Direct(Plant):
        """The plant without its balance."""

        balance = Unit.balance

    robot = load_robot("planar_2dof")
    (balanced, _), (direct, _) = jacobian_of(Plant, robot), jacobian_of(Direct, robot)
    # Two elimination orders of one matrix: 1e4 roundings of its largest entries.
    np.testing.assert_allclose(balanced, direct, rtol=0, atol=1e4 * EPS * np.abs(direct).max())


class Swapped(Unit):
    """Two masses whose balances are returned in the other order."""

    v = State("1", 2)
    v_rate = Derivative(v)

    def derivatives(self) -> None:
        self.v_rate = -self.v

    def balance(self):
        return (self.v_rate + self.v)[::-1]


@pytest.mark.parametrize("kind", ["step", "jacobian"])
def test_a_balance_without_the_derivative_of_its_row_is_refused_with_its_unit(kind):
    interface = Interface(Swapped, None)
    words = r"test_solver\.py, line \d+: balance\(\) of Swapped .* row 1 .*the order of the states"
    with pytest.raises(UnitError, match=words):
        interface.functions.casadi_function(interface.program.step[0].function.replace("step", kind))


def step_of(unit, robot):
    interface = Interface(unit, robot)
    return interface.functions.casadi_function(interface.program.step[0].function)


class Named(Unit):
    """A state that follows inputs with names of the solver's own."""

    y = Input("1")
    h = Input("1")
    v = State("1")
    v_rate = Derivative(v)

    def derivatives(self) -> None:
        self.v_rate = self.y + self.h - self.v


class NamedBalance(Named):
    """The same by its balance."""

    def balance(self):
        return self.v_rate + self.v - self.y - self.h


def test_inputs_of_a_balance_may_have_names_of_the_solver():
    direct, balanced = step_of(Named, None), step_of(NamedBalance, None)
    at = dict(zip(direct.name_in(), np.random.default_rng(0).uniform(0.1, 0.2, direct.n_in()), strict=True))
    x_new = [np.asarray(step(*(at[name] for name in step.name_in()))[0]) for step in (direct, balanced)]
    np.testing.assert_allclose(*x_new, rtol=0, atol=1e3 * EPS)  # a step is some hundred operations on numbers below 1


def test_a_long_chain_moves_as_scipy_moves_it():
    robot = repeated_link(12)
    solver = solver_of(Plant, tolerance=1e-10, robot=robot)
    assert solver.unit.x.size == 48
    solver.unit.group("tau")[:] = 0.05 * (-1.0) ** np.arange(12)
    other = Traced(solver.unit.interface)
    other.memory[:] = solver.unit.memory
    solver.advance(0.0, 0.02)
    ScipySolver(other).move(0.0, 0.02)
    assert np.abs(other.x).max() > 0.1
    # Steps of a tolerance of 1e-10 against LSODA at 1e-12: 100 of them give 1e-8, the stiffest states ten times that.
    # At 1e-9 a step that the error control nearly refuses, which one rounding decides, gives 2.5e-6.
    np.testing.assert_allclose(solver.unit.x, other.x, rtol=1e-7, atol=1e-7)


class Delay(Unit):
    """A chain of two delays of one period, beside a continuous integral of the input."""

    u = Input("1")
    period = Parameter("s", start=0.1, minimum=1e-6)
    first = Sampled("1", start=-1.0)
    second = Sampled("1", start=-2.0)
    count = Sampled("1")
    x = State("1")
    x_rate = Derivative(x)
    y = Output("1")

    def outputs(self) -> None:
        self.y = 10.0 * self.second + self.x

    def derivatives(self) -> None:
        self.x_rate = self.u + self.first

    def update(self) -> None:
        self.second = self.first
        self.first = self.u + self.x
        self.count = self.count + 1.0


@pytest.mark.parametrize("kind", [Traced, Plain])
def test_an_update_reads_all_states_of_before(kind):
    unit = kind(Interface(Delay, None))
    unit.start()
    assert [unit.group(name)[0] for name in ("first", "second", "count")] == [-1.0, -2.0, 0.0]
    unit.group("u")[:], unit.x[:] = 3.0, 0.5
    unit.update()
    assert [unit.group(name)[0] for name in ("first", "second", "count")] == [3.5, -1.0, 1.0]
    unit.outputs()
    assert unit.group("y")[0] == -9.5


@pytest.mark.parametrize("kind", [Traced, Plain])
@pytest.mark.parametrize("parts", [1, 3, 7])
def test_a_motion_samples_at_every_period_however_it_is_cut(kind, parts):
    unit = kind(Interface(Delay, None))
    unit.start()
    unit.group("u")[:] = 1.0
    motion = ScipySolver(unit)
    for begin, end in zip(*(np.linspace(0.0, 0.35, parts + 1)[i:][:parts] for i in (0, 1)), strict=True):
        motion.move(float(begin), float(end))
    # samples at 0, 0.1, 0.2 and 0.3: each sets first to 1 + x, so x grows by (2 + x) times the time to the next
    x, history = 0.0, []
    for duration in (0.1, 0.1, 0.1, 0.05):
        history.append(1.0 + x)
        x += (1.0 + history[-1]) * duration
    assert unit.group("count")[0] == 4.0
    # the rate is constant between the samples: roundings of scipy's steps
    np.testing.assert_allclose(unit.x, [x], rtol=0, atol=1e-12)
    assert [unit.group(name)[0] for name in ("first", "second")] == pytest.approx(history[:1:-1], abs=1e-12)
    assert unit.memory[-1] == 0.35


def test_samples_are_multiples_of_the_period_and_a_motion_that_runs_away_is_not_a_number():
    unit = Traced(Interface(Delay, None))
    assert [(round(a, 12), round(b, 12), s) for a, b, s in samples(unit, 0.0, 0.05, 0.3)] == [
        (0.05, 0.1, False), (0.1, 0.2, True), (0.2, 0.3, True),
    ]  # fmt: skip
    # a start that is no multiple of the period moves them all; a sum of ten steps is not 1, yet a sample
    assert [s for *_, s in samples(unit, 0.03, 0.03, 0.2)] == [True, True]
    assert [s for *_, s in samples(unit, 0.0, sum([0.1] * 10), 1.1)] == [True]
    assert list(samples(Traced(Interface(Logistic, None)), 0.0, 0.05, 0.3)) == [(0.05, 0.3, False)]

    class Exploding(Unit):
        """Infinite at t = 1."""

        x = State("1", start=1.0)
        x_rate = Derivative(x)

        def derivatives(self) -> None:
            self.x_rate = self.x**2

    unit = Traced(Interface(Exploding, None))
    unit.start()
    with np.errstate(over="ignore"):  # in scipy's own products
        ScipySolver(unit).move(0.0, 2.0)
    assert np.isnan(unit.x).all()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_solver_with_a_fixed_number_of_steps_makes_those_and_no_others(count):
    solver = solver_of(Fading, tolerance=1e-12, solver=SOLVERS.index(f"fixed_{count}"))
    solver.advance(0.0, 2.0)
    assert (solver.steps, solver.rejected, solver.h) == (count, 0, 1e-4)
    # Ends of the steps are rounded: an error of the step of 1e-16, times a slope below 1.
    np.testing.assert_allclose(solver.x, stepped(Fading, 2.0, count), rtol=1e-15, atol=1e-15)


def test_a_fixed_number_of_steps_ends_with_a_reason_where_states_are_not_finite():
    solver = solver_of(Ramp, solver=SOLVERS.index("fixed_2"), u=1e308, T=1e-9)
    solver.unit.group("u")[:] = np.inf
    with pytest.raises(KernelError, match=r"at t = 3 s state x is not finite, .* is fixed, 2\. .* solver adaptive"):
        solver.advance(3.0, 1.0)
    assert solver.x[0] == 0.0
