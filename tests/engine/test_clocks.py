"""Events and clocks of FMI 3.0."""

import numpy as np
import pytest

from tests.engine.files import assert_same_bits
from tests.engine.reference import models
from tests.engine.reference_fmus import BALL, STAIR
from tests.engine.texts import OWN_STEP
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.run import Results, Simulator, simulate

LOOP = {"c": (models.CONTROLLER, "3.0"), "p": (models.LAG, "3.0")}
WIRES = ["p.x -> c.e", "c.u -> p.u"]


def sampled_loop(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return state and control of the loop at every tenth of a second, by hand: Euler steps of 10 ms."""
    x = i = u = 0.0
    samples = []
    for k in range(steps + 1):
        if k % 10 == 0:
            u = 2.0 * (1.0 - x) + i
            i += 0.1 * 3.0 * (1.0 - x)
            samples.append((x, u))
        x += 0.01 * (u - x)
    sampled_x, sampled_u = np.array(samples).T
    return sampled_x, sampled_u


@pytest.mark.few(2)
@pytest.mark.parametrize("isolate", [False, True])
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_controller_with_a_periodic_clock(system, algorithm, version, isolate):
    """It answers at the time of its sample: no delay under either algorithm, whatever the plant's version."""
    path = system(LOOP | {"p": (models.LAG, version)}, WIRES)
    results = simulate(path, stop=2.0, step=0.1, algorithm=algorithm, isolate=isolate)
    x, u = sampled_loop(200)
    # the same operations in the same order
    np.testing.assert_allclose(results["p.x"], x, rtol=1e-14, atol=0)
    np.testing.assert_allclose(results["c.u"], u, rtol=1e-14, atol=0)


@pytest.mark.few(1)
@pytest.mark.parametrize("step", [0.05, 0.2, 0.4])
def test_ticks_between_communication_points_are_communication_points(system, step):
    results = simulate(system(LOOP, WIRES), stop=2.0, step=step)
    x, u = sampled_loop(200)
    every, rows = (1, slice(None, None, 2)) if step < 0.1 else (round(step / 0.1), slice(None))
    np.testing.assert_allclose(results["p.x"][rows], x[::every], rtol=1e-14, atol=0)
    np.testing.assert_allclose(results["c.u"][rows], u[::every], rtol=1e-14, atol=0)


def test_inputs_at_events_read_back_as_they_were(system, tmp_path):
    """An event brings the inputs up to date, so an input is no output of the row before."""
    path = system(LOOP, WIRES)
    simulate(path, stop=1.0, step=0.1, record=["*"], stream=tmp_path / "results.csv")
    results = Results.read(tmp_path / "results.csv")
    assert_same_bits(results, simulate(path, stop=1.0, step=0.1, record=["*"]))
    np.testing.assert_array_equal(results["c.e"], results["p.x"])


def test_periodic_countdown_and_triggered_clocks_tick_between_communication_points_too(system):
    """The table of the Reference FMU: inClock1 every second, inClock3 at 4 s, outClock at every fifth tick of both."""
    path = system({"clocks": (models.CLOCKS, "3.0"), "n": (models.COUNTER, "3.0")}, ["clocks.outClock -> n.c"])
    results = simulate(path, stop=9.0, step=1.0)
    assert results["clocks.inClock1Ticks"].tolist() == list(range(1, 11))
    assert results["clocks.inClock3Ticks"].tolist() == [0] * 4 + [1] * 6
    assert results["clocks.totalInClockTicks"].tolist() == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    assert results["n.n"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]
    path = system({"clocks": (models.CLOCKS, "3.0")})
    results = simulate(path, stop=9.1, step=0.7, parameters={"clocks.delay": 0.4})
    assert results["clocks.inClock1Ticks"].tolist() == (np.floor(results.time + 1e-9) + 1).tolist()
    assert results["clocks.inClock3Ticks"].tolist() == (results.time > 4.4).tolist()


def test_clocks_need_event_mode_and_sampling_and_ticks(system):
    with pytest.raises(SspError, match=r"c: .* has clocks \(r\) that tick in event mode; use gauss-seidel or jacobi"):
        simulate(system(LOOP, WIRES), stop=1.0, step=0.1, algorithm="extrapolated")
    notes = simulate(system({"n": (models.COUNTER, "3.0")}), stop=1.0, step=1.0).summary["notes"]
    assert "n.c: input is not connected and keeps its start value" in notes


@pytest.mark.heavy
def test_discrete_inputs_are_set_at_events(system):
    """Feedthrough of discrete inputs at the communication point itself, through two components."""
    events = models.feedthrough(("Int32", "Boolean"), "Events", models.EVENTS)
    path = system(
        {"s": (STAIR, "3.0"), "a": (events, "3.0"), "b": (events, "3.0")},
        ["s.counter -> a.Int32_input", "a.Int32_output -> b.Int32_input"],
    )
    results = simulate(path, stop=5.0, step=0.5, algorithm="jacobi")
    np.testing.assert_array_equal(results["b.Int32_output"], results["s.counter"])
    two = system({"s": (STAIR, "3.0"), "a": (models.FEEDTHROUGH_2, "2.0")}, ["s.counter -> a.Int32_input"])
    late = simulate(two, stop=5.0, step=0.5, algorithm="jacobi")  # FMI 2.0 has no events: a step later
    np.testing.assert_array_equal(late["a.Int32_output"][1:], late["s.counter"][:-1])


@pytest.mark.few(1)
@pytest.mark.parametrize("exchange", [False, True])
def test_components_that_stay_loaded_begin_anew(system, exchange):
    """Clocks, events and solver too."""
    ball = BALL._replace(exchange=exchange)
    path = system(LOOP | {"b": (ball, "3.0"), "s": (STAIR, "3.0")}, WIRES)
    with Simulator(path, isolate=False) as simulator:
        runs = [simulator.run(stop=2.0, step=0.1, parameters={"c.w": w}) for w in (1.0, 2.0, 1.0)]
    for name in runs[0].names:
        np.testing.assert_array_equal(runs[0][name], runs[2][name])
    assert runs[1]["p.x"][-1] > 1.5 * runs[0]["p.x"][-1]


def test_clocks_beside_components_with_steps_of_their_own_are_refused(system):
    with pytest.raises(UsageError, match=r"c: have clocks, and p their own steps; clocks need components that"):
        simulate(system(LOOP, WIRES, {"p": OWN_STEP.format(0.2)}), stop=1.0, step=0.1)
