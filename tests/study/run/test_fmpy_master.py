"""The example that is a master: nothing but fmpy and numpy, bit-identical to ours and close to scipy."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.conftest import heavy
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "examples" / "fmpy_master.py"
STOP, STEP = 0.3, 1e-3


@pytest.fixture(scope="module", params=["auto", *heavy("fmpy")])
def run(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    vdfmu.run("planar_tracking", stop=STOP, algorithm="gauss-seidel", stepper=request.param, out=folder, overwrite=True)
    return folder


@pytest.fixture(scope="module")
def signals(run):
    spec = spec_from_file_location("fmpy_master", EXAMPLE)
    example = module_from_spec(spec)
    spec.loader.exec_module(example)
    return example.simulate(run / "system.ssp", STOP, STEP)


def test_its_outputs_have_the_bits_of_gauss_seidel_with_steps_in_c_and_by_fmpy(run, signals):
    ours = vdfmu.Results.read(run / "results.csv")
    assert len(signals) > 40
    for name, values in signals.items():
        assert np.array_equal(values, ours[name]), name


def test_it_is_as_close_to_scipy_as_the_tolerance_of_the_plant(signals):
    """The tolerance is 1e-7 of states of order 1 rad, for steps that are longer than these of 1 ms."""
    system = SystemDescription(load_scenario("planar_tracking"))
    q = np.column_stack([signals["plant.q[1]"], signals["plant.q[2]"]])
    assert 0.0 < np.abs(q - reference("sampled", system, step=STEP, stop=STOP)["plant.q"]).max() < 1e-7


def test_it_prints_both(run):
    done = subprocess.run([sys.executable, EXAMPLE, run], capture_output=True, text=True, check=True)
    assert "45 of 45 outputs are bit-identical to those of vdfmu run." in done.stdout
    assert "from scipy's solution of the same equations: " in done.stdout
