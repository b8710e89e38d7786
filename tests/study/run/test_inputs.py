"""Signals from CSV files in scenarios, against the references."""

import dataclasses

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.engine.run import Results
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario

# As in test_reference.py: the local error per step is 1e-9 of states of order 1 (rad), some thousand steps add up.
POSITION = 1e-7


def wrench(folder):
    path = folder / "wrench.csv"
    rows = [(0.0, 0.0, 0.0), (0.0213, 20.0, -5.0), (0.0557, 20.0, 8.0), (0.0802, 0.0, 0.0)]
    lines = ["time,plant.F_e[1] [N],plant.F_e[2] [N]", *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.heavy
@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_a_run_with_a_wrench_from_a_file_meets_its_sampled_reference(tmp_path, backend, algorithm, hold):
    options = {"stop": 0.1, "backend": backend, "algorithm": algorithm, "out": False}
    path = wrench(tmp_path)
    results = vdfmu.run("planar_tracking", inputs=path, input_hold=hold, **options)
    assert results.summary["reference"]["sampled"]["max_position_difference_rad"] < POSITION
    assert results.summary["inputs"] == [str(path)]
    free = vdfmu.run("planar_tracking", reference=False, **options)
    assert np.abs(results["plant.q[1]"] - free["plant.q[1]"]).max() > 1e-3


@pytest.mark.heavy
@pytest.mark.parametrize("hold", [False, True])
def test_a_continuous_master_with_a_wrench_tends_to_the_continuous_reference(tmp_path, hold):
    """Under error control the steps end at the rows, and the difference is that of the coupling alone."""
    options = {"stop": 0.1, "algorithm": "iterative", "adaptive": 1e-6, "out": False}
    results = vdfmu.run("planar_tracking", inputs=wrench(tmp_path), input_hold=hold, **options)
    # 1e-6 per step of states of order 1, in a loop that forgets them; without a wrench it is as large
    assert results.summary["reference"]["continuous"]["max_position_difference_rad"] < 1e-6


@pytest.mark.heavy
def test_a_scenario_names_its_file_from_its_own_folder(tmp_path):
    folder = tmp_path / "cases"
    folder.mkdir()
    path = wrench(folder)
    text = (data_path("models") / "scenarios" / "planar_tracking.toml").read_text()
    (folder / "pushed.toml").write_text('inputs = "wrench.csv"\ninput_hold = true\n' + text)
    options = {"stop": 0.05, "reference": False, "out": False}
    named = vdfmu.run(folder / "pushed.toml", **options)
    direct = vdfmu.run("planar_tracking", inputs=path, input_hold=True, **options)
    np.testing.assert_array_equal(named["plant.q[1]"], direct["plant.q[1]"])
    np.testing.assert_array_equal(named["plant.F_e[1]"], direct["plant.F_e[1]"])
    assert direct["plant.F_e[1]"].max() == 20.0
    (folder / "pushed.toml").write_text('inputs = 3\ninput_hold = "yes"\n' + text)
    with pytest.raises(ModelError, match=r"inputs: .*\n.*input_hold: "):
        load_scenario(folder / "pushed.toml")


def test_a_reference_refuses_a_signal_for_no_free_input():
    scenario = load_scenario("planar_tracking")
    scenario = dataclasses.replace(scenario, inputs={"plant.tau[1]": ([0.0], [0.0])})
    with pytest.raises(UsageError, match=r"plant\.tau\[1\]: expected unconnected inputs"):
        reference("sampled", SystemDescription(scenario), step=1e-3, stop=1e-3)


@pytest.mark.heavy
def test_both_commands_take_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wrench(tmp_path)
    (tmp_path / "moment.csv").write_text("time,plant.F_e[6] [N.m]\n0,0.1\n0.05,0.3\n")
    options = ["--stop", "0.05", "--input", "wrench.csv", "--input", "moment.csv", "--input-hold"]
    for words in (["run", "planar_tracking", "--no-reference", "--out", "a"], ["run", "a/system.ssp", "--out", "b"]):
        ran(*words, *options)
    a, b = (Results.read(tmp_path / name / "results.csv") for name in "ab")
    np.testing.assert_array_equal(a["plant.q[1]"], b["plant.q[1]"])
    # held: until 21.3 ms the first row, then the second
    assert a["plant.F_e[1]"].tolist() == [0.0] * 23 + [20.0] * 28
    assert a["plant.F_e[6]"].tolist() == [0.1] * 51
