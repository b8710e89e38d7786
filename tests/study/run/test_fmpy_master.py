"""The example that is a master: nothing but fmpy and numpy, and the bits of ours."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

import vdfmu

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "fmpy_master.py"
COMPONENTS = {"Feedforward": "feedforward", "PDController": "controller", "Trajectory": "trajectory", "Plant": "plant"}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    done = subprocess.run([sys.executable, "-m", "vdfmu.cli", "build", "planar_tracking", "--out", folder], check=False)
    assert done.returncode == 0
    return folder


def test_it_has_at_most_80_lines_of_fmpy_and_numpy_and_the_bits_of_gauss_seidel(fmus, tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 80
    assert "vdfmu" not in [line.split()[1].partition(".")[0] for line in text.splitlines() if "import " in line]
    spec = spec_from_file_location("fmpy_master", EXAMPLE)
    example = module_from_spec(spec)
    spec.loader.exec_module(example)
    signals = example.simulate(fmus, stop=0.3, step=1e-3)
    vdfmu.run("planar_tracking", stop=0.3, master="gauss-seidel", reference=False, out=tmp_path)
    ours = vdfmu.Results.read(tmp_path / "results.csv")
    assert len(signals) > 40
    for name, values in signals.items():
        model, _, signal = name.partition(".")
        assert np.array_equal(values, ours[f"{COMPONENTS[model]}.{signal}"]), name
