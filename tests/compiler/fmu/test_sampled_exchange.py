"""Model exchange of a unit with continuous and sampled states: each sample is a time event of the importer."""

import ctypes as ct
import zipfile
from pathlib import Path

import fmpy
import fmpy.fmi2
import numpy as np
import pytest
from fmpy.model_description import read_model_description
from fmpy.validation import validate_fmu

from tests.compiler.native.binding import Instance, Model
from vdfmu.arm.fmus import build_fmus
from vdfmu.unit import Derivative, Input, Output, Parameter, Sampled, State, Unit

A, K, R, PERIOD = 2.0, 3.0, 1.0, 0.1


class Loop(Unit):
    """First-order lag with a sampled controller and a counter of its samples."""

    r = Input("1", text="setpoint", start=R)
    period = Parameter("s", text="time between samples", start=PERIOD, minimum=1e-6)
    x = State("1", text="state")
    x_rate = Derivative(x)
    s = Sampled("1", text="actuating signal")
    count = Sampled("1", text="number of samples")
    y = Output("1", text="sum")

    def outputs(self) -> None:
        """Sum."""
        self.y = self.x + self.s

    def derivatives(self) -> None:
        """Lag."""
        self.x_rate = self.s - A * self.x

    def update(self) -> None:
        """Feedback."""
        self.s = K * (self.r - self.x)
        self.count = self.count + 1.0


def solution(t: float) -> tuple[float, float, float]:
    """Exact x, s and count at a time that is not that of a sample; the samples are at 0, PERIOD, ..."""
    x, count = 0.0, int(t / PERIOD) + 1
    for k in range(count):
        s = K * (R - x)
        x = s / A + (x - s / A) * np.exp(-A * (min(t, (k + 1) * PERIOD) - k * PERIOD))
    return x, s, count


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def loop(request, tmp_path_factory):
    (path,) = build_fmus(None, tmp_path_factory.mktemp("loop"), units=[Loop], fmi_version=request.param).values()
    return path


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_an_importer_follows_the_samples(loop, kind):
    """Both kinds of FMU give the closed form."""
    # Local errors of 1e-10 (1 + x), x < 1, in less than 500 internal steps of a loop that contracts add up to less
    # than 1e-7. A row at a sample is before it in one kind and after it in the other, and left out.
    assert validate_fmu(str(loop)) == []
    assert read_model_description(loop).modelExchange is not None
    rows = fmpy.simulate_fmu(
        loop, fmi_type=kind, stop_time=0.98, output_interval=0.035, relative_tolerance=1e-10,
        start_values={"tolerance": 1e-10}, output=["x", "s", "count", "y"], record_events=False,
    )[1:]  # fmt: skip
    assert len(rows) == 28
    for t, x, s, count, y in rows.tolist():
        if abs(t / PERIOD - round(t / PERIOD)) > 1e-6:
            expected = solution(t)
            assert (x, s, count) == pytest.approx(expected, abs=1e-7)
            assert y == pytest.approx(expected[0] + expected[1], abs=2e-7)


@pytest.fixture
def unit(loop, tmp_path):
    """Make an instance for model exchange in event mode at the start time 0.25 s."""
    instance = Instance(Model(Path(fmpy.extract(loop, tmp_path))), "ModelExchange").start(0.25)
    yield instance
    instance.free()


def samples(unit: Instance) -> float | None:
    if unit.model.major == "2":
        info = fmpy.fmi2.fmi2EventInfo()
        unit.do("NewDiscreteStates", ct.byref(info))
        assert not (info.newDiscreteStatesNeeded or info.valuesOfContinuousStatesChanged)
        return info.nextEventTime if info.nextEventTimeDefined else None
    flags, time = (ct.c_bool * 5)(*5 * [True]), ct.c_double()
    at = ct.addressof(flags)
    unit.do("UpdateDiscreteStates", *(at + i for i in range(5)), ct.byref(time))
    assert not any(list(flags)[:4])
    return time.value if flags[4] else None


def at(unit: Instance, time: float) -> Instance:
    return unit.continuous().do("SetTime", time).do("EnterEventMode")


def test_a_sample_is_taken_once_however_often_events_are_iterated(unit):
    """The times are multiples of the period from the start time on, exactly as they are calculated."""
    assert unit.get("count") == 0.0
    for _ in range(3):
        assert samples(unit) == 0.25 + PERIOD
        assert unit.get("count") == 1.0 and unit.get("s") == unit.get("y") == K * R
    at(unit, 0.3)  # an event of the importer's own
    assert samples(unit) == 0.25 + PERIOD and unit.get("count") == 1.0
    at(unit, 0.25 + PERIOD).inputs([2.0])
    assert samples(unit) == 0.25 + 2 * PERIOD
    assert unit.get("count") == 2.0 and unit.get("s") == 2.0 * K
    at(unit, 0.25 + 5.5 * PERIOD)  # samples that the importer passed over are one
    assert samples(unit) == 0.25 + 6 * PERIOD and unit.get("count") == 3.0


def test_a_saved_state_has_the_samples_that_were_taken(unit):
    samples(at(unit, 0.25 + PERIOD))
    data = unit.complete()
    samples(at(unit, 0.25 + 3 * PERIOD))
    pointer = unit.deserialize(data)
    unit.restore(pointer).forget(pointer)
    assert unit.get("count") == 1.0
    assert samples(unit) == 0.25 + 2 * PERIOD and unit.get("count") == 1.0
    unit.do("Reset").start(0.25)
    assert samples(unit) == 0.25 + PERIOD and unit.get("count") == 1.0


def test_the_page_says_when_sampled_states_change(loop):
    with zipfile.ZipFile(loop) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "model exchange and co-simulation" in page
    assert "in event mode" in page
