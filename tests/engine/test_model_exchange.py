"""Components for model exchange, which the master integrates."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
from scipy.integrate import solve_ivp

from tests.compiler.eventful import Resting
from tests.conftest import heavy
from tests.engine.files import edited
from tests.engine.reference import models
from tests.engine.reference_fmus import Reference
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import CosimError, SspError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.run import simulate

VERSIONS = ["2.0", "3.0"]


def exchange(model: models.Model) -> models.Model:
    return replace(model, name=f"{model.name}ME", kinds=("ModelExchange",))


LAG = exchange(models.LAG)
BALL, DAHLQUIST, STAIR, VAN_DER_POL = (
    Reference(name, exchange=True) for name in ("BouncingBall", "Dahlquist", "Stair", "VanDerPol")
)
RUNAWAY = replace(LAG, name="Runaway", code="static void outputs(Instance *I) { I->d.der_x = 1 + I->d.x * I->d.x; }\n")
STIFF = replace(
    LAG, name="Stiff", code="static void outputs(Instance *I) { I->d.der_x = -1e6 * (I->d.x - cos(I->time)); }\n"
)


@pytest.mark.parametrize("isolate", [False, *heavy(True)])
@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_integrated_to_the_tolerance(system, version, isolate):
    path = system({"d": (DAHLQUIST, version), "v": (VAN_DER_POL, version)})
    results = simulate(path, stop=5.0, step=0.5, tolerance=1e-8, isolate=isolate)
    # local errors of 1e-8 in some 30 steps; the oscillator contracts to its cycle
    np.testing.assert_allclose(results["d.x"], np.exp(-results.time), atol=1e-7, rtol=0)
    exact = solve_ivp(
        lambda t, x: [x[1], (1 - x[0] ** 2) * x[1] - x[0]], (0, 5), [2.0, 0.0], "DOP853", results.time, rtol=1e-12,
        atol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(results["v.x0"], exact.y[0], atol=3e-7, rtol=0)


@pytest.mark.parametrize("step", [0.01, 0.5])
@pytest.mark.parametrize("version", VERSIONS)
def test_state_events_are_located(system, version, step):
    """The ball, by hand: impacts at sqrt(2 h / g) (1 + 2 e + 2 e^2 + ...), each with e times the speed."""
    results = simulate(system({"b": (BALL, version)}), stop=1.5, step=step, tolerance=1e-10)
    g, e = 9.81, 0.7
    fall = np.sqrt(2 / g)
    speed, begin = 0.0, 0.0
    expected = np.empty_like(results.time)
    edges = [fall * (1 + 2 * sum(e**i for i in range(1, k + 1))) for k in range(6)]
    for i, t in enumerate(results.time):
        k = int(np.searchsorted(edges, t))
        speed, begin, height = (0.0, 0.0, 1.0) if k == 0 else (g * fall * e**k, edges[k - 1], 0.0)
        expected[i] = height + speed * (t - begin) - 0.5 * g * (t - begin) ** 2
    # a parabola is integrated exactly; the time of an impact to rounding, and its error grows 1/e-fold at each
    np.testing.assert_allclose(results["b.h"], expected, atol=1e-9, rtol=0)
    np.testing.assert_allclose(results.summary["events"]["b"]["times"], edges[:2], atol=2e-9)


@pytest.mark.parametrize("version", VERSIONS)
def test_events_of_a_component_without_states_are_located(system, version):
    switch = exchange(
        models.Model(
            "Switch",
            [models.V("at", "output", start=0.0, variability="discrete"), models.V("z", more={"indicator": "1"})],
            "static void indicators(Instance *I, double *z) { z[0] = I->time - 0.35; }\n"
            "static void event(Instance *I) { I->d.at = I->time >= 0.35 && !I->d.at ? I->time : I->d.at; }\n",
            indicators=1,
        )
    )
    results = simulate(system({"s": (switch, version)}), stop=0.5, step=0.1)
    # 0.35 itself is not above zero, so the event is at the next number
    assert results["s.at"].tolist() == [0.0] * 4 + [np.nextafter(0.35, 1.0)] * 2


@pytest.mark.heavy
@pytest.mark.parametrize("step", [0.2, 0.7, 1.0])
@pytest.mark.parametrize("version", VERSIONS)
def test_time_events(system, version, step):
    results = simulate(system({"s": (STAIR, version)}), stop=7.0, step=step)
    assert results["s.counter"].tolist() == (np.floor(results.time + 1e-9) + 1).tolist()
    assert results.summary["events"]["s"]["times"] == list(range(1, 8))


def test_the_end_that_a_component_makes_and_a_failure_in_its_step_leave_the_rows(system):
    results = simulate(system({"s": (STAIR, "3.0")}), stop=10.0, step=1.0)
    assert results.summary["ended"] == {"component": "s", "time": pytest.approx(9.0)}
    burst = models.Model(
        "Burst", [models.V("y", "output", start=0.0)],
        "static void outputs(Instance *I) { I->d.y = I->time > 8.5 ? NAN : 0; }\n", step=1.0,
    )  # fmt: skip
    with pytest.raises(CosimError, match="y is nan") as failed:
        simulate(system({"s": (STAIR, "3.0"), "b": (burst, "3.0")}), stop=12.0, step=1.0)
    assert failed.value.results.time.tolist() == [float(k) for k in range(9)]


@pytest.mark.heavy
@pytest.mark.parametrize("version", VERSIONS)
def test_a_sampled_controller_of_an_integrated_plant(system, version):
    path = system({"c": (models.CONTROLLER, "3.0"), "p": (LAG, version)}, ["p.x -> c.e", "c.u -> p.u"])
    results = simulate(path, stop=1.0, step=0.1, tolerance=1e-9)
    x = i = 0.0
    for k in range(11):
        u = 2.0 * (1.0 - x) + i
        # ten steps, each to 1e-9
        assert results["p.x"][k] == pytest.approx(x, abs=1e-8)
        assert results["c.u"][k] == pytest.approx(u, abs=1e-7)
        i += 0.1 * 3.0 * (1.0 - x)
        x = u + (x - u) * np.exp(-0.1)


@pytest.mark.heavy
@pytest.mark.parametrize("isolate", [False, True])
@pytest.mark.parametrize("algorithm", ["extrapolated", "iterative"])
def test_inputs_run_over_the_step(system, algorithm, isolate):
    """Two tanks that level out, one of each version: second order in the step, by steps that can be repeated."""
    path = system({"a": (LAG, "2.0"), "b": (LAG, "3.0")}, ["a.x -> b.u", "b.x -> a.u"])
    errors = []
    for step in (0.1, 0.05):
        results = simulate(
            path, stop=1.0, step=step, algorithm=algorithm, tolerance=1e-10, parameters={"a.x": 1.0}, isolate=isolate
        )
        errors.append(np.abs(results["a.x"] - 0.5 * (1 + np.exp(-2 * results.time))).max())
    # the first step of extrapolated knows no slope, and adds an error of first order for one step: of second in all
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


@pytest.mark.heavy
def test_stiff_components(system, monkeypatch):
    """By the implicit method: the explicit one would need a step of some microseconds, 300,000 of them."""
    steps = 0

    def counted(method):
        class Counted(method):
            def step(self):
                nonlocal steps
                steps += 1
                return super().step()

        return Counted

    for name in ("DOP853", "Radau"):
        monkeypatch.setattr(scipy.integrate, name, counted(getattr(scipy.integrate, name)))
    results = simulate(system({"s": (STIFF, "3.0")}), stop=1.0, step=0.1, parameters={"s.x": 1.0}, isolate=False)
    np.testing.assert_allclose(results["s.x"], np.cos(results.time), atol=1e-5)
    assert 0 < steps < 30_000  # a tenth of those of the explicit method


def test_states_that_become_infinite(system):
    with pytest.raises(CosimError, match=r"r failed .* in doStep: the states cannot be integrated beyond t = 1\.57"):
        simulate(system({"r": (RUNAWAY, "2.0")}), stop=2.0, step=0.5, isolate=False)


@pytest.mark.few(1)
@pytest.mark.parametrize("version", VERSIONS)
def test_a_unit_with_events_bounces_as_the_reference_fmu(pack, xml, built, tmp_path, version):
    """By the integrator of this master for model exchange, and by its own solver for co-simulation, until all rest."""
    (unit,) = build_fmus(None, tmp_path / "fmus", units=[Resting], fmi_version=version).values()
    extra = {"resources/Own.fmu": unit.read_bytes(), f"resources/Ball_{version[0]}.fmu": built(BALL, version)}
    ports, kind = "h:output v:output", 'implementation="{}"'.format
    path = pack([
        xml.component("own", "Own", ports, attributes=kind("ModelExchange")),
        xml.component("stepped", "Own", ports, attributes=kind("CoSimulation")),
        xml.component("reference", f"Ball_{version[0]}", ports, attributes=kind("ModelExchange")),
    ], extra=extra)  # fmt: skip
    results = simulate(path, stop=3.0, step=0.05, tolerance=1e-10)
    for name in ("own", "stepped"):
        # parabolas are integrated to rounding; the times of 11 bounces too, and each velocity magnifies their error
        np.testing.assert_allclose(results[f"{name}.h"], results["reference.h"], atol=1e-9, rtol=0)
        np.testing.assert_allclose(results[f"{name}.v"], results["reference.v"], atol=1e-8, rtol=0)
        assert results[f"{name}.v"][-1] == 0.0


@pytest.mark.heavy
def test_the_part_that_the_ssd_asks_for(pack, xml, built):
    both = xml.component("a", "Lag_3", "", attributes='implementation="ModelExchange"')
    path = pack([both], extra={"resources/Lag_3.fmu": built(models.LAG, "3.0")})
    results = simulate(path, stop=1.0, step=0.5, parameters={"a.x": 1.0}, tolerance=1e-9)
    assert results["a.x"][-1] == pytest.approx(np.exp(-1.0), abs=1e-8)  # not what Euler's method of the FMU gives
    other = xml.component("a", "LagME_3", "", attributes='implementation="CoSimulation"')
    path = pack([other], extra={"resources/LagME_3.fmu": built(LAG, "3.0")})
    with pytest.raises(SspError, match=r"the SSD requires CoSimulation, resources/LagME_3.fmu has ModelExchange"):
        simulate(path, stop=1.0, step=0.5)


def test_scheduled_execution_alone_is_refused(pack, built, tmp_path):
    model = replace(models.LAG, name="Scheduled", kinds=())
    scheduled = b'<ScheduledExecution modelIdentifier="Scheduled"/><ModelVariables>'
    fmu = edited(built(model, "3.0"), [(b"<ModelVariables>", scheduled)])
    path = pack(["a Scheduled_3"], extra={"resources/Scheduled_3.fmu": fmu})
    message = r"expected an FMU for CoSimulation or ModelExchange, got one for ScheduledExecution"
    alone = tmp_path / "alone.fmu"
    alone.write_bytes(fmu)
    for file in (alone, path):
        (problem,) = inspect_file(file).problems
        assert re.search(message, problem)
    with pytest.raises(SspError, match=message):
        simulate(path, stop=1.0, step=0.5)
