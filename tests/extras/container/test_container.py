"""The container FMU: as jacobi to the bit, valid, and what it cannot hold."""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import vdfmu
from tests.compiler.unit.motor import write_motor
from tests.conftest import ran, refused
from tests.engine.conftest import component
from tests.engine.reference import models
from tests.engine.reference_fmus import Reference
from tests.engine.texts import OWN_STEP
from vdfmu.base.errors import UsageError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.extras.container import write_container
from vdfmu.unit import Input, Parameter, Sampled, Unit

STOP = 0.2


class Sampling(Unit):
    """Input at samples."""

    u = Input("1")
    period = Parameter("s", start=0.01, minimum=1e-6)
    y = Sampled("1")

    def update(self) -> None:
        """Sample."""
        self.y = self.u


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    finished = {}

    def once(**options):
        key = tuple(sorted(options.items()))
        if key not in finished:
            folder = tmp_path_factory.mktemp("run")
            finished[key] = (folder, vdfmu.run("planar_tracking", stop=STOP, out=folder, reference=False, **options))
        return finished[key]

    return once


@pytest.fixture(scope="module")
def container(runs, tmp_path_factory):
    folder, _ = runs(backend="native", algorithm="jacobi")
    return write_container(folder / "system.ssp", tmp_path_factory.mktemp("c") / "arm.fmu", step=1e-3)


def simulated(path, output, **options):
    return fmpy.simulate_fmu(str(path), stop_time=STOP, output_interval=1e-3, output=output, **options)


@pytest.mark.heavy
def test_the_container_runs_in_plain_fmpy_as_jacobi_does_to_the_bit(runs, container):
    _, jacobi = runs(backend="native", algorithm="jacobi")
    # FMPy's container says nothing of dependencies, so its outputs depend on all; nothing else is to be said
    assert validate_fmu(str(container)) == []
    outputs = fmpy.read_model_description(str(container)).outputs
    names = [unknown.variable.name for unknown in outputs]
    assert len(names) > 40  # all outputs of the four units
    result = simulated(container, names)
    for name in names:  # the same libraries on the same numbers
        np.testing.assert_array_equal(result[name], jacobi[name])


@pytest.mark.heavy
def test_the_container_has_the_inputs_of_its_units_and_the_same_bits_each_time(runs, container, tmp_path):
    for name, value in (("controller.K_p[1]", 100.0), ("plant.F_e[2]", 30.0)):
        _, jacobi = runs(backend="native", algorithm="jacobi")
        changed = simulated(container, ["plant.q[1]"], start_values={name: value})
        assert np.abs(changed["plant.q[1]"] - jacobi["plant.q[1]"]).max() > 1e-7
    folder, _ = runs(backend="native", algorithm="jacobi")
    token = fmpy.read_model_description(str(container)).guid
    again = write_container(folder / "system.ssp", tmp_path / "again.fmu", step=1e-3)
    assert again.read_bytes() == container.read_bytes()
    other = write_container(folder / "system.ssp", tmp_path / "other.fmu", step=2e-3)
    assert fmpy.read_model_description(str(other)).guid != token


@pytest.mark.heavy
def test_a_container_that_cannot_be_made_says_why(runs, tmp_path):
    folder, _ = runs(backend="python", algorithm="jacobi")
    with pytest.raises(UsageError, match="needs Python"):
        write_container(folder / "system.ssp", tmp_path / "x.fmu", step=1e-3)
    for step in (0.0, float("inf"), float("nan")):
        with pytest.raises(UsageError, match="step: expected a positive finite time"):
            write_container(folder / "system.ssp", tmp_path / "x.fmu", step=step)
    assert not (tmp_path / "x.fmu").exists()


@pytest.mark.heavy
@pytest.mark.parametrize("words", ["planar_tracking", "slider_tracking --step 0.0005"])
def test_what_the_command_writes_has_no_problems(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran("build", *words.split(), "--container")
    (path,) = tmp_path.glob("*.fmu")
    report = inspect_file(path)
    assert (report.problems, report.ran) == ([], True)


def test_a_package_has_its_own_robot_and_values():
    assert "--robot is for a scenario" in refused("build", "x.ssp", "--container", "--robot", "planar_2dof")


def test_a_system_that_cannot_be_one_fmu_says_why(pack, tmp_path):
    ring = pack(["a Adder a:input b:input y:output"], ["a.y -> a.a"])
    with pytest.raises(UsageError, match="algebraic loop during initialization: .* run the system without"):
        write_container(ring, tmp_path / "x.fmu", step=0.5)


def test_a_container_refuses_connections_that_convert_a_type(system, tmp_path):
    units = dict.fromkeys("ab", (models.FEEDTHROUGH_2, "2.0"))
    path = system(units, ["a.Int32_output -> b.Float64_input"])
    with pytest.raises(UsageError, match="b.Float64_input: a container FMU converts no types, got Integer to Real"):
        write_container(path, tmp_path / "c.fmu", step=0.1)


def test_a_container_does_not_step_units_with_a_step_of_their_own(pack, tmp_path):
    slow = component("s", "Gain", "u:input y:output", OWN_STEP.format(0.5))
    path = pack(["r Ramp y:output", slow], ["r.y -> s.u"])
    with pytest.raises(UsageError, match="s: has its own step, but a container FMU steps all together"):
        write_container(path, tmp_path / "c.fmu", step=0.125)


def test_a_container_does_not_integrate(system, tmp_path):
    with pytest.raises(UsageError, match="a container FMU steps co-simulation"):
        write_container(system({"a": (Reference("Dahlquist", exchange=True), "2.0")}), tmp_path / "c.fmu", step=0.5)


@pytest.mark.heavy
def test_steps_of_a_container_are_multiples_of_a_units_period(tmp_path):
    system = vdfmu.connect({"free": Sampling, "control": Sampling}, {"free.y": "control.u"})
    with pytest.raises(UsageError, match="control: samples every 0.01 s, expected a whole multiple"):
        system.container(tmp_path / "c.fmu", step=0.004)
    assert system.container(tmp_path / "c.fmu", step=0.005).exists()


@pytest.mark.heavy
def test_a_system_without_a_robot_is_one_fmu_but_takes_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_motor(tmp_path)
    assert "obot" not in ran("build", "motor.toml", "--container").output
    assert list(tmp_path.glob("*.fmu"))
    assert "takes a robot" in refused("build", "motor.toml", "--container", "--robot", "planar_2dof")
