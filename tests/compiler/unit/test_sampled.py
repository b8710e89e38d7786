"""Loops through sampled states, against own loops: when a sample acts, and periods that the steps do not meet."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from scipy.linalg import expm

import vdfmu
from tests.compiler.native.binding import Instance, Model
from tests.conftest import heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.run import Simulator

STEP, STOP, K, D, START = 0.01, 0.6, 30.0, 4.0, 0.2
UNITS = '''
import numpy as np
from vdfmu.unit import Derivative, Input, Output, Parameter, Sampled, State, Unit


class Cart(Unit):
    """Mass of 1 kg with a damper of 0.5 N.s/m."""

    u = Input("N", text="force")
    x = State("m", text="position", start=0.2)
    v = State("m/s", text="velocity")
    x_dot = Derivative(x)
    v_dot = Derivative(v)

    def derivatives(self):
        self.x_dot = self.v
        self.v_dot = self.u - 0.5 * self.v


class Control(Unit):
    """PD with the velocity by differences; the force is kept in a sampled state."""

    x = Input("m", text="position")
    period = Parameter("s", text="time between samples", start=0.01, minimum=1e-6)
    old = Sampled("m", text="last position", start=0.2)
    held = Sampled("N", text="force", DELAYED)
    u = Output("N", text="force")

    def update(self):
        self.held = -30.0 * self.x - 4.0 * (self.x - self.old) / self.period
        self.old = self.x

    def outputs(self):
        self.u = self.held


class Encoder(Unit):
    """Position at samples."""

    x = Input("m", text="position")
    bias = Input("m", text="error")
    period = Parameter("s", text="time between samples", start=0.01, minimum=1e-6)
    y = Sampled("m", text="sample", start=0.2)

    def update(self):
        self.y = self.x + self.bias


class Coarse(Unit):
    """Position in steps of 1 mm, which depends on nothing but the rounded input."""

    x = Input("m", text="position")
    period = Parameter("s", text="time between samples", start=0.01, minimum=1e-6)
    y = Sampled("m", text="sample", start=0.2)

    def update(self):
        self.y = 1e-3 * np.floor(self.x / 1e-3 + 0.5)


class Wrapped(Coarse):
    """Position in a range of 1 m, in steps where it rounds, with a slope of its own."""

    def update(self):
        self.y = self.x - np.floor(self.x)


class Clock(Unit):
    """A sampled state that nothing feeds."""

    period = Parameter("s", text="time between samples", start=0.01, minimum=1e-6)
    count = Sampled("1", text="number of samples")

    def update(self):
        self.count = self.count + 1.0
'''
SYSTEM = 'name = "loop"\ndescription = "loop"\n[components]\n{}\n[connections]\n{}\n'
SCENARIO = f"""name = "loop"
description = "A cart on a sampled controller"
robot = "planar_2dof"
system = "{{}}.toml"
stop = {STOP}
step = {STEP}
algorithm = "{{}}"
tolerance = 1e-12
"""
PAIR = ["cart:Cart", "control:Control"]
CHAIN = {"cart.x": "encoder.x", "encoder.y": "control.x", "control.u": "cart.u"}
SYSTEMS = {
    "plain": (PAIR, {"cart.x": "control.x", "control.u": "cart.u"}),
    "chain": ([*PAIR, "encoder:Encoder"], CHAIN),
    "coarse": ([*PAIR, "encoder:Coarse"], CHAIN),
    "wrapped": ([*PAIR, "encoder:Wrapped"], CHAIN),
    "ring": ([*PAIR, "encoder:Encoder"], CHAIN | {"control.old": "encoder.bias"}),
    "clock": (["clock:Clock"], {}),
}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    def write(system: str, algorithm: str = "gauss-seidel", delayed: bool = False) -> Path:
        folder = tmp_path_factory.mktemp(system)
        (folder / "loop.py").write_text(UNITS.replace("DELAYED", f"delayed={delayed}"))
        units, links = SYSTEMS[system]
        listed = [f'{name} = "loop.py:{unit}"' for name, _, unit in (each.partition(":") for each in units)]
        joined = [f'"{start}" = ["{end}"]' for start, end in links.items()]
        (folder / f"{system}.toml").write_text(SYSTEM.format("\n".join(listed), "\n".join(joined)))
        (folder / "scenario.toml").write_text(SCENARIO.format(system, algorithm))
        return folder / "scenario.toml"

    return write


@pytest.fixture
def run(tmp_path):
    def run(scenario: Path, **options: Any) -> Any:
        return vdfmu.run(scenario, out=tmp_path / "results", **({"reference": False} | options))

    return run


def own_loop(delay: int = 0, every: int = 1, measured: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return positions at the communication points and forces of the steps."""
    # The force acts `delay` steps after its sample, the position is `measured` steps old, a sample is taken at each
    # `every`-th step.
    A = np.array([[0.0, 1.0, 0.0], [0.0, -0.5, 1.0], [0.0, 0.0, 0.0]])
    E = expm(STEP * A)
    x, old, held, forces, rows = np.array([START, 0.0]), START, 0.0, [0.0] * delay, [START]
    for k in range(round(STOP / STEP)):
        if k % every == 0:
            seen = rows[max(0, k - measured)]
            held = -K * seen - D * (seen - old) / (every * STEP)
            old = seen
        forces.append(held)
        x = E[:2, :2] @ x + E[:2, 2] * forces[k]
        rows.append(float(x[0]))
    return np.array(rows), np.array(forces)


# The solver's local errors, 1e-12 a step, in a loop that contracts: less than 60 of them.
CLOSE = {"rtol": 0.0, "atol": 1e-11}


@pytest.mark.parametrize("options", [{}, *heavy({"fmi_version": "3.0"}, {"backend": "python"})], ids=str)
def test_a_sample_acts_in_the_step_that_follows(scenario, run, options):
    """No delay but the hold, from the first step on; both references have the same."""
    results = run(scenario("plain"), reference=True, **options)
    rows, forces = own_loop()
    np.testing.assert_allclose(results["cart.x"], rows, **CLOSE)
    # difference quotients of positions, 4/0.01 of them
    np.testing.assert_allclose(results["control.u"][1:], forces, rtol=0.0, atol=1e-8)
    assert forces[0] == -K * START
    assert results.summary["notes"] == []
    for compared in results.summary["reference"].values():
        assert compared["max_difference"]["cart.x"] < 1e-10  # scipy's tolerance of 1e-11, over the motion


@pytest.mark.heavy
@pytest.mark.parametrize("every", [2, 3])
def test_a_slower_controller_holds_between_its_samples(scenario, run, every):
    results = run(scenario("plain"), parameters={"control.period": every * STEP})
    np.testing.assert_allclose(results["cart.x"], own_loop(every=every)[0], **CLOSE)


@pytest.mark.heavy
def test_a_chain_of_sampled_units_has_no_delay_but_a_delayed_state_which_breaks_a_loop(scenario, run):
    """Encoder, controller and cart in one step, in whatever order they are listed, as in the references."""
    results = run(scenario("chain"), reference=True)
    np.testing.assert_allclose(results["cart.x"], own_loop()[0], **CLOSE)
    for compared in results.summary["reference"].values():
        assert compared["max_difference"]["cart.x"] < 1e-10  # as above
    with pytest.raises(SspError, match="algebraic loop in the steps: .*control.*encoder"):
        run(scenario("ring"))
    results = run(scenario("plain", delayed=True))
    np.testing.assert_allclose(results["cart.x"], own_loop(delay=1)[0], **CLOSE)


@pytest.mark.heavy
def test_jacobi_has_a_step_of_delay_for_each_unit_and_says_so(scenario, run):
    results = run(scenario("plain", "jacobi"))
    np.testing.assert_allclose(results["cart.x"], own_loop(delay=1)[0], **CLOSE)
    (note,) = results.summary["notes"]
    assert note.startswith("control: samples every 0.01 s; a sample acts on u a step later, after 0.01 s")
    results = run(scenario("chain", "jacobi"))
    np.testing.assert_allclose(results["cart.x"], own_loop(delay=1, measured=1)[0], **CLOSE)
    assert len(results.summary["notes"]) == 2


def test_the_fmu_declares_that_samples_depend_on_inputs_and_names_its_period(scenario, tmp_path, version):
    file = scenario("plain").parent / "loop.py"
    (path,) = build_fmus(None, tmp_path, units=[f"{file}:Control"], fmi_version=version).values()
    description = fmpy.read_model_description(str(path), validate=True)
    sources = {u.variable.name: [v.name for v in u.dependencies or ()] for u in description.outputs}
    assert sources == {"old": ["x"], "held": ["x"], "u": ["x"]}
    assert float(description.defaultExperiment.stepSize or "nan") == 0.01


@pytest.mark.few(4)
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
@pytest.mark.parametrize(
    ("period", "way"), [(STEP / 2, 0.005), (1.5 * STEP, 0.0075), (0.7 * STEP, 0.007), (2.5 * STEP, 0.008333)]
)
def test_a_period_that_steps_do_not_meet_is_refused(scenario, run, algorithm, period, way):
    with pytest.raises(UsageError) as caught:
        run(scenario("plain", algorithm), parameters={"control.period": period})
    message = str(caught.value)
    assert f"control: samples every {period:g} s, expected a whole multiple of its step 0.01 s" in message
    assert f"such as {way:.4g}" in message and "--set control.period=0.0" in message


@pytest.mark.heavy
def test_a_period_counts_in_packages_and_each_run(scenario, run, tmp_path):
    """That of the package, and one that is given for a run; what has no inputs may sample as it will."""
    assert run(scenario("clock"), parameters={"clock.period": STEP / 4})["clock.count"][-1] == 4 * STOP / STEP
    run(scenario("plain"), stop=STEP)
    package = tmp_path / "results" / "system.ssp"
    with Simulator(package, isolate=False) as simulator:
        for step in (0.01, 0.005, 0.01 / 3):  # thirds have rounding
            simulator.run(step=step, stop=6 * step)
        with pytest.raises(UsageError, match=r"--set control\.period=0\.008"):
            simulator.run(step=0.004, stop=0.04)
        with pytest.raises(UsageError, match=r"such as 0\.007 s"):
            simulator.run(parameters={"control.period": 0.007})


def test_derivatives_of_samples_are_declared_and_transposed(scenario, tmp_path):
    """Of the next sample by inputs and by sampled states, backwards the same numbers."""
    file = scenario("plain").parent / "loop.py"
    (path,) = build_fmus(None, tmp_path, units=[f"{file}:Control"], fmi_version="3.0").values()
    unit = Instance(Model(Path(fmpy.extract(str(path), str(tmp_path / "x")))), "CoSimulation").start()
    unit.step(STEP)
    old, held, u = (v for v in unit.model.variables if v.name in ("old", "held", "u"))
    (x,) = unit.model.of("input")
    knowns, unknowns = [x, old, held], [old, held, u]
    J = np.array([unit.directional(unknowns, knowns, seed) for seed in np.eye(3)]).T
    wanted = [[1, 0, 0], [-K - D / STEP, D / STEP, 0], [0, 0, 1]]
    np.testing.assert_allclose(J, wanted, rtol=1e-14)  # rounding
    assert np.array_equal([unit.adjoint(unknowns, knowns, seed) for seed in np.eye(3)], J)
    unit.free()
