"""References of systems with events, against closed forms, and runs of their FMUs against the references."""

import math
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.compiler import eventful
from tests.conftest import heavy
from vdfmu.base.errors import UsageError
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.study.report.shown_run import read_run
from vdfmu.study.sampling import ambiguous
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.program import SystemProgram
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

CHOPPED = '''
import numpy as np
from vdfmu.unit import Derivative, Event, Held, State, Unit, where


class Chopped(Unit):
    """A ramp that is on for a share of each second, which an event changes."""

    x = State("s", text="time that it was on")
    x_dot = Derivative(x)
    share = Held("1", text="share", start=0.25)
    full = Event("s", text="time above the limit")

    def derivatives(self):
        self.x_dot = where(self.t - np.floor(self.t) < self.share, 1.0, 0.0)

    def events(self):
        self.full = self.x - 0.625

    def at_full(self):
        self.share = 0.75
'''


@pytest.fixture
def scenario(tmp_path):
    def write(components: dict[str, str], connections: str = "", stop: float = 10.0, step: float = 0.1) -> Path:
        names = {name: f"{eventful.__file__}:{unit}" if "/" not in unit else unit for name, unit in components.items()}
        listed = "\n".join(f'{name} = "{unit}"' for name, unit in names.items())
        (tmp_path / "system.toml").write_text(
            f'name = "s"\ndescription = "s"\n[components]\n{listed}\n[connections]\n{connections}\n'
        )
        (tmp_path / "scenario.toml").write_text(
            f'name = "s"\ndescription = "s"\nsystem = "system.toml"\nstop = {stop}\nstep = {step}\n'
            'algorithm = "gauss-seidel"\ntolerance = 1e-9\n'
        )
        return tmp_path / "scenario.toml"

    return write


def solve(name: str, path: Path, stop: float, step: float):
    loaded = load_scenario(path)
    return reference(name, SystemDescription(loaded, system_values(loaded)), stop=stop, step=step)


@pytest.mark.parametrize("name", ["continuous", *heavy("sampled", "sampled-delayed")])
def test_units_with_events_of_their_own(scenario, name):
    path = scenario({"ball": "Ball", "heater": "Thermostat", "counter": "Counter"}, stop=2.5)
    solution = solve(name, path, 2.5, 0.1)
    expected = np.array([eventful.ball(t) for t in solution.t])
    # 1e-9 of each step at worst; 11 bounces magnify the error of the time by 1 / (0.1 m/s)
    np.testing.assert_allclose(solution["ball.h"][:, 0], expected[:, 0], atol=1e-7)
    assert np.array_equal(solution["ball.bounces"][:, 0], expected[:, 2])
    heated = [eventful.thermostat(t)[0] for t in solution.t]
    np.testing.assert_allclose(solution["heater.T"][:, 0], heated, atol=1e-7)
    assert np.array_equal(solution["counter.turns"][:, 0], [eventful.counter(t) for t in solution.t])


LOOP = '"lag.turned" = "relay.u"\n"relay.y" = "lag.u"'


def cycle(t: float) -> float:
    """Lag of 1 s under a relay of hysteresis 0.5, from 0.6 on, towards -1 first."""
    first, half = math.log(3.2), math.log(3.0)
    if t < first:
        return -1.0 + 1.6 * math.exp(-t)
    k, rest = divmod(t - first, half)
    return (1.0 - 1.5 * math.exp(-rest)) * (-1.0) ** k


@pytest.mark.heavy
def test_a_relay_drives_a_limit_cycle(scenario):
    """The continuous reference has the closed form. FMUs that look at communication points have their reference's."""
    path = scenario({"lag": "Lag", "relay": "Relay"}, LOOP, step=0.01)
    solution = solve("continuous", path, 10.0, 0.1)
    # 1e-12 of rows, and the error of the time at each of 8 switchings
    np.testing.assert_allclose(solution["lag.x"][:, 0], [cycle(t) for t in solution.t], atol=1e-9)
    assert set(solution["relay.y"][:, 0]) == {-1.0, 1.0}
    results = vdfmu.run(path, out=False)
    compared = results.summary["reference"]
    assert compared["sampled"]["max_difference"]["lag.x"] < 1e-8  # tolerances of 1e-9, in a motion that contracts
    assert compared["sampled"]["max_difference"]["relay.y"] == 0.0
    # each of 8 switchings is up to two steps of 0.01 s late, at up to 1.5 1/s; the last is late by all
    assert 0.01 < compared["continuous"]["max_difference"]["lag.x"] < 8 * 0.02 * 1.5


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["continuous", "sampled"])
def test_an_event_moves_a_switching_by_time(scenario, tmp_path, name):
    """On for 0.25 s of the first two seconds, then until 2.125 s, where 0.625 s are reached, and on to 2.75 s."""
    (tmp_path / "chopped.py").write_text(CHOPPED)
    path = scenario({"c": f"{tmp_path}/chopped.py:Chopped"}, stop=4.0, step=1.0)
    solution = solve(name, path, 4.0, 1.0)
    # tolerances of 1e-9 between switchings
    np.testing.assert_allclose(solution["c.x"][:, 0], [0.0, 0.25, 0.5, 1.25, 2.0], atol=1e-8)
    results = vdfmu.run(path, out=False, reference=False)
    np.testing.assert_allclose(results["c.x"], [0.0, 0.25, 0.5, 1.25, 2.0], atol=1e-7)


def test_programs_of_lanes_and_pages_refuse_events(scenario):
    loaded = load_scenario(scenario({"ball": "Ball"}))
    with pytest.raises(UsageError, match="ball: has events, at which internal steps end"):
        SystemProgram(SystemDescription(loaded, system_values(loaded)))


def test_held_states_are_not_asked_about(scenario, tmp_path):
    """A held state of a law in continuous time is not taken for a sampled one."""
    loaded = load_scenario(scenario({"lag": "Lag", "relay": "Relay"}, LOOP, step=0.01))
    values = system_values(loaded)
    package = write_ssp(loaded, build_parts(loaded, tmp_path / "fmus", values), tmp_path / "loop.ssp", values)
    checked = check_system(load_ssp(package))
    (link,) = (link for link in checked.links if link.start == ("relay", "y"))
    assert link.source.variability == "discrete"
    assert [name for name in ambiguous(checked) if checked.descriptions[name].samples is not False] == []
    assert "sampled" not in vdfmu.judge(package).text


@pytest.mark.parametrize("backend", ["native", *heavy("python")])
def test_a_run_says_its_events_and_their_times(scenario, tmp_path, backend):
    path = scenario({"ball": "Ball", "heater": "Thermostat"}, stop=2.5, step=0.5)
    results = vdfmu.run(
        path, out=tmp_path / "out", reference=False, backend=backend, parameters={"heater.tau": 0.01}, tolerance=1e-9
    )
    happened = read_run(tmp_path / "out").summary["events"]
    assert happened == results.summary["events"]
    first = math.sqrt(2.0 / eventful.G)
    flights = [2.0 * first * 0.7**k for k in range(1, 11)]
    # 1e-9 of each step; the error of a time is that of the height over the speed there, 0.1 m/s at least
    np.testing.assert_allclose(happened["ball.ground"]["times"], first + np.cumsum([0.0, *flights]), atol=1e-7)
    assert happened["ball.ground"]["count"] == 11
    hot, cold = (happened[f"heater.{name}"] for name in ("hot", "cold"))
    assert hot["count"] + cold["count"] == results["heater.switched"][-1] == eventful.thermostat(2.5, 0.01)[2]
    assert hot["count"] > 500 == len(hot["times"]) and hot["last"] > hot["times"][-1]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "ball.ground at 0.45152, 1.0837, 1.5261, " in page and "summary.json has the first 500" in page


@pytest.mark.parametrize("adaptive", [None, 1e-3])
def test_events_of_steps_that_are_undone_do_not_count(adaptive):
    units = {"lag": eventful.Lag, "relay": eventful.Relay}
    system = vdfmu.connect(units, {"lag.turned": "relay.u", "relay.y": "lag.u"}, algorithm="extrapolated")
    results = system.run(stop=10.0, step=0.01, adaptive=adaptive)
    assert (results.summary["communication"]["rejected"] > 0) == (adaptive is not None)
    rows = np.flatnonzero(np.diff(results["relay.y"]))
    happened = results.summary["events"]
    assert happened["relay.up"]["count"] + happened["relay.down"]["count"] == rows.size > 4
