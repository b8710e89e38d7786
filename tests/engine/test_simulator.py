"""Runs of components that stay loaded: each is what it would be alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.conftest import heavy
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.run import Simulator, simulate

BY_HAND = ["gauss-seidel", "jacobi", "extrapolated"]
OPTIONS = {"stop": 0.05, "step": 1e-3}
CHANGED = {"plant.I_m[1]": 2e-3}  # another rotor, so another run


def same(a, b):
    return a.names == b.names and all(np.array_equal(a[name], b[name]) for name in a)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("backend", "algorithm"),
    [*(("native", each) for each in ALGORITHMS), ("python", "iterative"),
     *heavy(*(("python", each) for each in ALGORITHMS if each != "iterative"))],
)  # fmt: skip
def test_each_run_is_that_of_components_that_are_new(arm_package, backend, algorithm):
    options = OPTIONS | {"stop": 0.02}
    alone = simulate(arm_package(backend), algorithm=algorithm, **options)
    changed = simulate(arm_package(backend), algorithm=algorithm, parameters=CHANGED, **options)
    assert not same(alone, changed)
    with Simulator(arm_package(backend), algorithm=algorithm) as simulator:
        first = simulator.run(**options)
        other = simulator.run(parameters=CHANGED, **options)
        again = simulator.run(**options)
    assert same(first, alone) and same(again, alone)
    assert same(other, changed)
    assert first.summary["notes"] == again.summary["notes"] == alone.summary["notes"]


@pytest.mark.heavy
def test_isolated_components_run_again(package):
    with Simulator(package, isolate=True) as simulator:
        first = simulator.run(**OPTIONS)
        again = simulator.run(**OPTIONS)
    assert first.summary["isolated"]
    assert same(first, again)


def test_what_is_wrong_is_told_where_it_is_said(package):
    simulator = Simulator(package)
    with pytest.raises(UsageError, match="'with Simulator"):
        simulator.run(**OPTIONS)
    with simulator:
        with pytest.raises(UsageError, match=r"has no variable 'mess'"):
            simulator.run(parameters={"plant.mess": 1.0}, **OPTIONS)
        with pytest.raises(UsageError, match="expected a multiple of step = 0.001 s"):
            simulator.run(stop=0.0015, step=1e-3)
        assert len(simulator.run(**OPTIONS)) == 51
    with pytest.raises(UsageError, match="within a block"):
        simulator.run(**OPTIONS)
    with pytest.raises(UsageError, match="tolerance must be positive"):
        Simulator(package, tolerance=0.0)
    with pytest.raises((SspError, UsageError)), Simulator(package, parameters={"plant.mess": 1.0}):
        pass


def pushed(simulator, force, steps=50):
    """Step by hand under a force of each step; return positions, row by row."""
    simulator.reset(**OPTIONS)
    rows = [simulator.get("plant.q")]
    for k in range(steps):
        simulator.set("plant.F_e[2]", force(k))
        simulator.step()
        rows.append(simulator.get("plant.q"))
    return np.array(rows)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("backend", "algorithm"),
    [*(("native", each) for each in BY_HAND), ("python", "extrapolated"),
     *heavy(*(("python", each) for each in BY_HAND[:-1]))],
)  # fmt: skip
def test_steps_by_hand_are_those_of_a_run(arm_package, backend, algorithm):
    times = OPTIONS["step"] * np.arange(51)
    force = np.where(times > 0.0, 5.0 * np.sin(200.0 * times), 0.0)
    inputs = {"plant.F_e[2]": (times, force)}
    options = {"algorithm": algorithm, "isolate": False}
    run = simulate(arm_package(backend), inputs=inputs, input_hold=True, **options, **OPTIONS)
    with Simulator(arm_package(backend), **options) as simulator:
        first = pushed(simulator, lambda k: force[k])
        assert simulator.time == OPTIONS["stop"]
        assert simulator.get("plant.E_kin") == run["plant.E_kin"][-1]
        assert simulator.get("plant.mass[1]") == 2.0  # of the robot's file, which no row has
        again = pushed(simulator, lambda k: force[k])
        other = pushed(simulator, lambda k: 0.0)
    np.testing.assert_array_equal(first, run["plant.q"])
    np.testing.assert_array_equal(again, first)
    assert np.any(other != first)


def test_by_hand_runs_and_other_values_take_turns(package):
    with Simulator(package) as simulator:
        plain = simulator.run(**OPTIONS)
        simulator.reset(**OPTIONS, parameters=CHANGED)
        simulator.step(50)
        changed = simulator.get("plant.q")
        assert same(simulator.run(**OPTIONS), plain)
        with pytest.raises(UsageError, match="no run by hand has begun"):
            simulator.step()
        seen = []
        simulator.run(
            **OPTIONS, record=[], observer=SimpleNamespace(row=lambda *row: seen.append(row), wanted=["plant.q"])
        )
        count = len(seen)
        simulator.reset(**OPTIONS)
        simulator.step(50)
        assert len(seen) == count > 0
        np.testing.assert_array_equal(simulator.get("plant.q"), plain["plant.q"][-1])
    assert np.any(changed != plain["plant.q"][-1])


def test_what_is_wrong_by_hand_is_said_and_a_reset_is_cheap(package, calls):
    with Simulator(package) as simulator:
        simulator.reset(**OPTIONS)
        for name, text in (
            ("plant.tau[1]", "controller.tau\\[1\\] is connected to it"),
            ("plant.q_0[1]", "Set it before the run"),
            ("plant.nothing", "no variable 'nothing'"),
        ):
            with pytest.raises(UsageError, match=text):
                simulator.set(name, 0.0)
        with pytest.raises(UsageError, match="no signal 'plant.nothing'"):
            simulator.get("plant.nothing")
        with pytest.raises(UsageError, match="expected at most 50: the run is at t = 0 s and ends at 0.05 s"):
            simulator.step(51)
        for count in (-1, 1.5, "1"):
            with pytest.raises(UsageError, match="expected a (whole number|number of steps, 0 or more)"):
                simulator.step(count)
        simulator.step(50)
    with Simulator(package) as simulator:
        first = calls(lambda: simulator.reset(**OPTIONS))
        again = calls(lambda: simulator.reset(**OPTIONS))
    assert again < first / 50  # four states of some kB are copied: 129 calls, and 20,900 with an initialization
