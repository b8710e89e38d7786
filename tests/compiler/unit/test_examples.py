"""Units of a user's own: those of examples/units, built, run and compared as a user would."""

import json
from itertools import pairwise

import fmpy
import numpy as np
import pytest

import vdfmu
from tests.compiler.unit.conftest import EXAMPLES, command
from vdfmu.base.errors import ModelError
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.run import simulate
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario.values import system_values

# name of the file, whether it needs a robot, model
UNITS = [
    ("friction_torque", True, "FrictionTorque"), ("spline", True, "Spline"), ("low_pass", False, "LowPass"),
    ("encoder", True, "Encoder"), ("wall", True, "Wall"),
]  # fmt: skip
NAMES = [name for name, _, _ in UNITS]


@pytest.mark.heavy
@pytest.mark.parametrize(("name", "needs", "model"), UNITS, ids=NAMES)
def test_build_makes_a_valid_fmu_of_the_file(examples, name, needs, model, version):
    options = ["--robot", "planar_2dof"] if needs else []
    done = command("build", examples / f"{name}.py", *options, "--fmi", version, "--out", "fmus")
    assert done.exit_code == 0, done.output
    path = examples.parent / "fmus" / f"{model}.fmu"
    assert path.is_file()
    assert fmpy.read_model_description(str(path), validate=True).fmiVersion == version
    checked = command("check", path)
    assert checked.exit_code == 0 and "no problems" in checked.output, checked.output


@pytest.mark.heavy
def test_run_agrees_with_the_assembled_reference(examples):
    done = command("run", examples / "scenario.toml", "--out", "results")
    assert done.exit_code == 0, done.output
    summary = json.loads((examples.parent / "results" / "summary.json").read_text())
    compared = summary["reference"]["sampled"]["max_difference"]
    # The bound of the project. The plant is solved to a relative 1e-8 of states of order 1, and the loop, damped within
    # 0.1 s, forgets; 1.7e-10 rad is what is seen.
    assert compared["plant.q"] <= 1e-7
    # One sample late and in steps of 2e-5 rad, on both sides: the same steps, or a difference would be a whole one.
    assert compared["encoder.q_measured"] == 0.0
    # Polynomials of the same coefficients in the C of the FMU and in numpy: 10 roundings of terms up to 1e3.
    assert compared["trajectory.q_d"] <= 10 * 1e3 * np.finfo(float).eps


@pytest.mark.heavy
def test_run_tends_to_the_continuous_reference_with_the_step(system):
    """With an encoder that has fine steps, and without contact: these two are not continuous."""
    coarse, stop = 2e-3, 0.2
    settings = {"encoder.resolution": 1e-9, "wall.distance": 10.0, "encoder.period": 2 * coarse}
    description = SystemDescription(system.scenario, system_values(system.scenario, settings))
    q = reference("continuous", description, step=coarse, stop=stop)["plant.q"]
    errors = []
    for k in (1, 2, 4):
        results = simulate(system.package, stop=stop, step=coarse / k, algorithm="gauss-seidel", parameters=settings)
        errors.append(np.abs(results["plant.q"][::k] - q).max())
    # Inputs held over a step are an error of first order: half of it at half of the step, except for higher orders.
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.3), errors
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.3), errors


def test_derivatives_of_the_spline_are_those_of_its_position(example, planar):
    unit = Plain(Interface(example("spline"), planar))
    orders = ["q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot"]

    def at(t):
        unit.memory[-1] = t  # the time
        unit.outputs()
        return {name: unit.group(name).copy() for name in orders}

    h = 1e-4
    for t in (0.07, 0.41, 0.93):
        before, here, after = (at(t + k * h) for k in (-1, 0, 1))
        for order, derivative in pairwise(orders):
            slope = (after[order] - before[order]) / (2 * h)
            # h^2 / 6 of the third derivative of each, which grows by 10 / 0.3 s with each order
            scale = np.abs(here[derivative]).max() + np.abs(here[order]).max()
            np.testing.assert_allclose(here[derivative], slope, rtol=0, atol=1e-4 * scale)
    points = np.loadtxt(EXAMPLES / "waypoints.csv", delimiter=",", skiprows=1)
    for t, *q in points:  # meets the waypoints, at rest
        here = at(t)
        # 10 terms of up to 1e3: rounding
        np.testing.assert_allclose(here["q_d"], q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(here["q_d_dot"], 0.0, atol=1e-9)
        np.testing.assert_allclose(here["q_d_ddot"], 0.0, atol=1e-7)


def test_an_unknown_signal_in_a_system_file_stays_an_error(examples):
    text = (examples / "arm.toml").read_text()
    (examples / "arm.toml").write_text(text.replace('"controller.q_dot", "wall', '"controller.q_punkt", "wall'))
    with pytest.raises(ModelError, match=r"arm\.toml: connections: controller\.q_punkt: expected an input"):
        vdfmu.run(examples / "scenario.toml", out="results", reference=False)
