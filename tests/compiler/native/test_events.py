"""FMUs of units with events: co-simulation and model exchange against closed forms, saved states, failures."""

import ctypes as ct
from pathlib import Path

import fmpy
import fmpy.fmi2
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from tests.compiler import eventful
from tests.compiler.native.binding import Instance, Model, same_bits
from tests.conftest import heavy
from vdfmu.arm.fmus import build_fmus

FORMS = ["2.0", "3.0", *heavy("python")]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    made: dict[tuple[str, str], Path] = {}

    def build(name: str, form: str) -> Path:
        if (name, form) not in made:
            kind = {"backend": "python"} if form == "python" else {"fmi_version": form}
            folder = tmp_path_factory.mktemp("events")
            (made[name, form],) = build_fmus(None, folder, units=[getattr(eventful, name)], **kind).values()
        return made[name, form]

    return build


@pytest.fixture
def instance(built, tmp_path):
    instances: list[Instance] = []

    def make(name: str, form: str, kind: str = "CoSimulation", **options) -> Instance:
        model = Model(Path(fmpy.extract(built(name, form), tmp_path / f"{name}{len(instances)}")))
        instances.append(Instance(model, kind, **options))
        return instances[-1]

    yield make
    for each in instances:
        each.free()


def run(path: Path, stop: float, step: float, *names: str, kind: str = "CoSimulation", **start):
    return fmpy.simulate_fmu(
        str(path), fmi_type=kind, stop_time=stop, output_interval=step, output=list(names), start_values=start,
        record_events=False, **({"step_size": step} if kind == "CoSimulation" else {"relative_tolerance": 1e-10}),
    )  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [0.1, 2.5])
def test_a_ball_bounces(built, form, step):
    """Rodas4 is exact for a parabola: rounding of 1e-15 m, over 11 bounces that magnify the time's by 1 / 0.1 m/s."""
    assert form == "python" or validate_fmu(str(built("Ball", form))) == []
    rows = run(built("Ball", form), 2.5, step, "h", "v", "bounces")
    expected = np.array([eventful.ball(t) for t in rows["time"]])
    assert expected[-1, 2] == 11.0
    np.testing.assert_allclose(rows["h"], expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(rows["v"], expected[:, 1], atol=1e-10)
    assert np.array_equal(rows["bounces"], expected[:, 2])


@pytest.mark.parametrize("form", FORMS[:2])
def test_a_ball_bounces_in_model_exchange(built, form):
    """CVODE at 1e-10, whose times of the bounces a velocity of 0.1 m/s magnifies."""
    rows = run(built("Ball", form), 2.5, 0.1, "h", "v", "bounces", kind="ModelExchange")
    expected = np.array([eventful.ball(t) for t in rows["time"]])
    np.testing.assert_allclose(rows["h"], expected[:, 0], atol=1e-8)
    np.testing.assert_allclose(rows["v"], expected[:, 1], atol=1e-6)
    assert np.array_equal(rows["bounces"], expected[:, 2])


@pytest.mark.few(2)
@pytest.mark.parametrize("solver", [0, 3])
@pytest.mark.parametrize("form", FORMS[:2])
def test_a_thermostat_switches(built, form, solver):
    """23 switchings, by as many internal steps as the tolerance needs or by a fixed number of 10 / 3 s."""
    rows = run(built("Thermostat", form), 250.0, 10.0, "T", "on", "switched", tolerance=1e-10, solver=solver)
    expected = np.array([eventful.thermostat(t) for t in rows["time"]])
    # 1e-10 (1 + 21 K) of some 100 internal steps; the steps of 3 s to 1/30 of the time constant have 1e-7 K
    np.testing.assert_allclose(rows["T"], expected[:, 0], atol=1e-6 if solver else 1e-8)
    assert np.array_equal(rows["on"], expected[:, 1])
    assert np.array_equal(rows["switched"], expected[:, 2])


@pytest.mark.few(1)
@pytest.mark.parametrize("form", FORMS)
def test_a_clutch_locks_and_an_input_breaks_it(instance, form):
    unit = instance("Clutch", form).start()
    unit.step(3.0)
    # an exact solution of constant torques: rounding, and the time's
    np.testing.assert_allclose(unit.get("w"), 2.0 + 1.0 / 3.0, rtol=1e-12)
    assert unit.get("side") == 0.0
    np.testing.assert_allclose(unit.get("passed"), 2.0 / 3.0, rtol=1e-12)
    unit.step(1.0, tau=6.0)  # which breaks it at the start of the step
    np.testing.assert_allclose(unit.get("w"), np.add(2.0 + 1.0 / 3.0, [4.0, 1.0]), rtol=1e-12)
    assert unit.get("side") == 1.0


@pytest.mark.parametrize("form", FORMS)
def test_a_unit_without_continuous_states_looks_at_communication_points(instance, form):
    unit = instance("Relay", form).start(u=0.9)
    seen = []
    for u in (0.6, 0.2, 0.7, 0.5, -0.5, -0.6, 0.5, 0.51, -9.0):
        seen.append(float(unit.step(0.1, u=u).get("y")))
    # above the threshold at the start, which is no rise
    assert seen == [-1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0]


@pytest.mark.parametrize("form", FORMS)
def test_an_event_may_cause_another_at_the_same_time(instance, form):
    unit = instance("Chain", form).start(u=-1.0).step(0.1)
    assert (unit.get("a"), unit.get("b")) == (0.0, 0.0)
    unit.step(0.1, u=1.0)
    assert (unit.get("a"), unit.get("b")) == (1.0, 1.0)


@pytest.mark.few(2)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("width", [1e-5, 1e-3, 0.5])
def test_two_changes_in_an_internal_step_are_found(instance, form, width):
    """A parabola however narrow, and a triangle wider than an eighth of the step: 0.6 of 4."""
    unit = instance("Pulse", form).start(width=width).step(4.0)
    assert unit.get("count") == 2.0


@pytest.mark.parametrize("form", FORMS)
def test_a_saved_state_repeats_events_to_the_bit(instance, form):
    """Between bounces, and with a number above 0, whose next rise alone counts; as bytes in another instance too."""
    unit, other = instance("Ball", form).start().step(0.3), instance("Ball", form)
    time, state = unit.time, unit.save()
    first = [unit.step(0.17).outputs() for _ in range(9)]
    unit.restore(state).time = time
    assert all(same_bits(unit.step(0.17).outputs(), row) for row in first)
    other.restore(other.deserialize(unit.serialize(state))).time = time
    assert all(same_bits(other.step(0.17).outputs(), row) for row in first)
    relay = instance("Relay", form).start().step(0.1, u=0.7)
    state = relay.save()
    relay.step(0.1, u=-0.7).restore(state).time = 0.1
    relay.step(0.1, u=0.8)
    assert relay.get("y") == 1.0


@pytest.mark.parametrize("form", FORMS)
def test_events_without_an_end_fail_and_change_nothing(instance, form):
    words = r"events do not end: there are more than \d+ (in the step|in one interval), the last of ground"
    ball = instance("Ball", form).start().step(1.0)
    before, derivatives = ball.outputs(), ball.read(ball.model.of("local")) if form != "python" else 0.0
    with ball.refuses(words) as refused:
        refused("DoStep", *ball.step_arguments(1.0, 2.0))
    assert np.array_equal(ball.outputs(), before)
    assert form == "python" or np.array_equal(ball.read(ball.model.of("local")), derivatives)
    ball.step(1.4)
    assert ball.get("h") == pytest.approx(eventful.ball(2.4)[0], abs=1e-10)
    if form != "python":
        fixed = instance("Ball", form).start(solver=2).step(1.0)
        with fixed.refuses(words) as refused:
            refused("DoStep", *fixed.step_arguments(1.0, 2.0))
    endless = instance("Endless", form).start().step(0.1)
    with endless.refuses("events do not end: there are more than 100 at one time, the last of") as refused:
        refused("DoStep", *endless.set(u=1.0).step_arguments(0.1, 0.1))
    assert endless.step(0.1, u=0.2).get("a") == 1.0


# ------------------------------------------------------------------ model exchange


def discrete_states(unit: Instance) -> bool:
    """Update discrete states, and return whether continuous states changed."""
    if unit.model.major == "2":
        info = fmpy.fmi2.fmi2EventInfo()
        unit.do("NewDiscreteStates", ct.byref(info))
        assert not (info.newDiscreteStatesNeeded or info.nextEventTimeDefined)
        return bool(info.valuesOfContinuousStatesChanged)
    flags, time = (ct.c_bool * 5)(*5 * [True]), ct.c_double()
    at = ct.addressof(flags)
    unit.do("UpdateDiscreteStates", *(at + i for i in range(5)), ct.byref(time))
    assert not (flags[0] or flags[1] or flags[2] or flags[4])
    return flags[3]


def indicators(unit: Instance, n: int) -> list[float]:
    values = (ct.c_double * n)()
    unit.do("GetEventIndicators", values, n)
    return list(values)


@pytest.mark.parametrize("form", FORMS[:2])
def test_reading_does_not_lose_an_event(instance, form):
    """An importer may read all outputs at the event before it updates; a number of 0 is not above 0."""
    unit = instance("Ball", form, "ModelExchange").start()
    assert not discrete_states(unit)
    unit.continuous().do("SetTime", 0.1).states([0.0, -3.0])
    assert -1e-300 < indicators(unit, 1)[0] < 0.0
    unit.do("SetTime", 0.2).states([-1e-9, -3.0])
    assert unit.get("ground") == 1e-9 == indicators(unit, 1)[0]
    unit.do("EnterEventMode")
    assert unit.get("ground") == 1e-9
    assert discrete_states(unit) and not discrete_states(unit)
    assert unit.get_states().tolist() == [0.0, pytest.approx(2.1, abs=1e-15)]
    assert unit.get("bounces") == 1.0
    with unit.continuous().refuses("expected 1 values, one an event indicator, got 2") as refused:
        refused("GetEventIndicators", (ct.c_double * 2)(), 2)


@pytest.mark.parametrize("form", FORMS[:2])
def test_an_update_that_does_not_end_changes_nothing(instance, form):
    unit = instance("Endless", form, "ModelExchange").start()
    discrete_states(unit)
    unit.set(u=1.0)
    last = (fmpy.fmi2.fmi2EventInfo(),) if form == "2.0" else None
    flags, time = (ct.c_bool * 5)(), ct.c_double()
    arguments = [ct.byref(*last)] if last else [*(ct.addressof(flags) + i for i in range(5)), ct.byref(time)]
    name = "NewDiscreteStates" if last else "UpdateDiscreteStates"
    with unit.refuses("events do not end: there are more than 100 at one time") as refused:
        refused(name, *arguments)
    assert unit.get("a") == 1.0
    unit.set(u=0.0)
    assert not discrete_states(unit)


def test_intermediate_updates_see_events_and_their_inputs_cause_them(instance):
    """Each internal step that an event ends has an update. A torque set in that of the lock breaks it at once."""
    times: list[float] = []

    def update(unit: Instance, time: float, may_set: bool, _: bool) -> None:
        times.append(time)
        if may_set and time > 1.99:
            unit.set(tau=6.0)

    unit = instance("Clutch", "3.0", update=update).start().step(4.0)
    assert min(abs(time - 2.0) for time in times) < 1e-14
    assert unit.get("side") == 1.0
    np.testing.assert_allclose(unit.get("w"), np.add(2.0, 2.0 * np.array([4.0, 1.0])), rtol=1e-12)
