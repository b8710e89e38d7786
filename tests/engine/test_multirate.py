"""Components with steps of their own, which annotations give: each is stepped by its multiple of the step."""

import numpy as np
import pytest

from tests.conftest import heavy
from tests.engine.texts import OWN_STEP
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run import Simulator, simulate

LIBCOSIM = (
    '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><StepSizeHint '
    'xmlns="http://opensimulationplatform.com/SSP/OSPAnnotations" value="{}"/></ssc:Annotation></ssd:Annotations>'
)


@pytest.fixture
def system(pack, xml):
    """Return a package of a ramp into a slow unit into a fast one, each with the FMU and step given."""

    def write(slow="Gain", step=0.5, annotation=OWN_STEP, fast="Plant"):
        c = xml.component
        own_step = annotation.format(step) if step else ""
        return pack(
            ["r Ramp y:output", c("s", slow, "u:input y:output", own_step), c("p", fast, "u:input y:output")],
            ["r.y -> s.u", "s.y -> p.u"],
        )

    return write


@pytest.mark.few(4)
@pytest.mark.parametrize("annotation", [OWN_STEP, LIBCOSIM])
@pytest.mark.parametrize("isolate", [False, *heavy(True)])
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("slow", ["Gain", "Lag"])
def test_a_slow_unit_does_at_its_points_what_it_does_by_itself(system, slow, algorithm, isolate, annotation):
    """Steps of powers of two: times have no rounding, so the numbers are the same to the last bit."""
    options = {"stop": 4.0, "algorithm": algorithm, "isolate": isolate, "record": ["*"]}
    alone = simulate(system(slow, None), step=0.5, **options)
    beside = simulate(system(slow, 0.5, annotation), step=0.125, **options)
    assert np.array_equal(beside["s.y"][::4], alone["s.y"])
    assert np.ptp(alone["s.y"]) > 1.0  # it moves at all
    held = beside["s.y"][1:].reshape(-1, 4) if slow == "Gain" and algorithm == "gauss-seidel" else (
        beside["s.y"][:-1].reshape(-1, 4)
    )  # fmt: skip  # what is passed on holds for the step that begins, what is computed till it ends
    assert np.all(held == held[:, :1])
    assert np.array_equal(beside["s.u"][1:].reshape(-1, 4)[:, 0], alone["s.u"][1:])
    assert np.all(np.diff(beside["r.y"]) == 0.125)


def test_a_sampled_controller_holds_its_output_for_its_own_step_cut_at_the_stop(system):
    """Gain gives 2 t at its points; the plant sums it over 0.5 s each: 0.5 (0 + 1 + 2 + 3)."""
    results = simulate(system(), stop=2.0, step=0.125, algorithm="gauss-seidel")
    assert results["p.y"][-1] == 3.0
    # Lag takes any step: with the input of 1.5 s it goes on for 0.25 s.
    results = simulate(system("Lag"), stop=1.75, step=0.125, algorithm="jacobi")
    before, after = results["s.y"][12], results["s.y"][14]
    assert results["s.y"][13] == before
    # the unit's own formula, in doubles
    assert after == pytest.approx(1.5 + (before - 1.5) * np.exp(-0.25), rel=1e-14)


def test_steps_that_do_not_go_together_are_refused(system):
    with pytest.raises(
        UsageError, match=r"s: its step 0\.5 s is not a whole multiple of the communication step 0\.2 s"
    ):
        simulate(system(), stop=2.0, step=0.2)
    with pytest.raises(UsageError, match=r"s: its step 0\.05 s is not a whole multiple"):
        simulate(system(step=0.05), stop=2.0, step=0.5)
    with pytest.raises(UsageError, match="s: have their own steps, but iterative takes one step for all"):
        simulate(system(), stop=2.0, step=0.25, algorithm="iterative")
    with pytest.raises(SspError, match="component 's': expected a positive finite communicationStepSize, got -1"):
        load_ssp(system(step=-1))


@pytest.mark.heavy
def test_a_unit_that_passes_on_and_has_a_state_needs_jacobi(pack, xml):
    path = pack(
        ["r Ramp y:output",
         xml.component("s", "Mixed", "u:input y:output z:output", OWN_STEP.format(0.5)),
         "p Plant u:input load:input"],
        ["r.y -> s.u", "s.y -> p.u", "s.z -> p.load"],
    )  # fmt: skip
    with pytest.raises(UsageError, match=r"s: has its own step, passes inputs on within it, and its state s\.y is"):
        simulate(path, stop=2.0, step=0.25, algorithm="gauss-seidel")
    results = simulate(path, stop=2.0, step=0.25, algorithm="jacobi")
    assert results["s.y"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4]
    assert inspect_file(path).problems == []


@pytest.mark.heavy
def test_runs_of_one_simulator_may_have_other_steps(system):
    path = system("Lag")
    with Simulator(path, isolate=False) as simulator:
        runs = [simulator.run(stop=2.0, step=step) for step in (0.5, 0.125, 0.25)]
    for run in runs:
        assert np.array_equal(run["s.y"], simulate(path, stop=2.0, step=run.summary["step"])["s.y"])
