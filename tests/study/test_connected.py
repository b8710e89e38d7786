"""`vdfmu.build`, `vdfmu.connect` and `vdfmu.load`: FMUs and systems in one call each."""

import math
import pickle
import re
from pathlib import Path

import fmpy
import numpy as np
import pytest

import vdfmu
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import SspError, UsageError
from vdfmu.base.files import data_path
from vdfmu.engine.results.verdict import DOUBTFUL, Check, verdict_of

Lag = find_unit(data_path("examples") / "units" / "low_pass.py")


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("lags")
    return {
        fmi: vdfmu.build(Lag, folder / f"lag_{fmi[0]}.fmu", fmi=fmi, T=0.2) for fmi in ("2.0", "3.0")
    }  # fmt: skip


def test_build_names_the_file_and_sets_start_values(fmus):
    for fmi, path in fmus.items():
        description = fmpy.read_model_description(str(path))
        assert description.fmiVersion == fmi
        assert [v.start for v in description.modelVariables if v.name == "T"] == ["0.2"]


def test_build_takes_vectors_and_refuses_other_names(tmp_path):
    fmu = vdfmu.build("PDController", tmp_path / "pd.fmu", robot="planar_2dof", K_p=[3.0, 4.0], K_v=5.0)
    starts = {v.name: v.start for v in fmpy.read_model_description(str(fmu)).modelVariables}
    assert [float(starts[f"K_{k}[{i}]"]) for k in "pv" for i in (1, 2)] == [3.0, 4.0, 5.0, 5.0]
    with pytest.raises(UsageError, match="expected one value, or 2 for K_p"):
        vdfmu.build("PDController", tmp_path / "pd.fmu", robot="planar_2dof", K_p=[1.0, 2.0, 3.0])
    with pytest.raises(UsageError, match=r"path must end in \.fmu"):
        vdfmu.build(Lag, tmp_path / "lag.zip")
    with pytest.raises(UsageError, match="robot must be given for Plant"):
        vdfmu.build("plant", tmp_path / "plant.fmu")


def test_fmus_of_two_versions_and_a_class_run_as_one_system(fmus, tmp_path):
    system = vdfmu.connect(
        {"a": fmus["2.0"], "b": Lag, "c": fmus["3.0"]}, {"a.y": "b.u", "b.y": "c.u"}, stop=1.0, step=1e-3
    )
    for each in (system, vdfmu.load(system.write(tmp_path / "lags.ssp"))):
        assert list(each.components) == ["a", "b", "c"]
        assert each.connections == ["a.y -> b.u", "b.y -> c.u"]
        assert each.inputs == ["a.u"]
        results = each.run(parameters={"a.u": 1.0, "b.T": 0.05})
        # the step response of three lags, two of them with one time constant
        t, T, fast = results.time, 0.2, 0.05
        gap = T - fast
        exact = 1.0 - (fast**2 / gap**2) * np.exp(-t / fast)
        exact -= ((T**2 - 2 * T * fast) / gap**2 + t / gap) * np.exp(-t / T)
        # gauss-seidel with inputs held: a delay of up to one step for each of two connections, times the
        # largest slope, 1 / (e T)
        assert np.abs(results["c.y"] - exact).max() < 2 * 1e-3 / (math.e * T)


def test_vectors_connect_by_name_and_a_plain_signal_connects_to_a_torque():
    system = vdfmu.connect(
        {"pd": "PDController", "f": Lag, "arm": "plant"}, {"pd.tau": "arm.tau", "arm.q": ["pd.q"]}, robot="planar_2dof"
    )
    assert system.connections == ["pd.tau -> arm.tau (2)", "arm.q -> pd.q (2)"]
    system = vdfmu.connect({"f": Lag, "arm": "plant"}, [("f.y", ("arm.tau[1]", "arm.tau[2]"))], robot="planar_2dof")
    assert "connection f.y -> arm.tau[1]: passes '1' as 'N.m', without a conversion" in system.notes
    assert "arm.F_e (6)" in repr(system)
    results = system.run(stop=0.01, step=1e-3, parameters={"f.u": 3.0, "f.y_0": 3.0})
    assert not [note for note in results.summary["notes"] if "arm.tau" in note and "not connected" in note]


def test_all_faults_of_names_come_at_once_and_misfits_name_both_ends():
    with pytest.raises(UsageError) as error:
        vdfmu.connect({"a": Lag, "b": Lag}, {"a.z": "c.u", "b.u": "a.u", "a.y": "b.v"}, parameters={"a.w": 1.0})
    assert str(error.value).splitlines() == [
        "a.z -> c.u: a has no variable 'z'. Its outputs: y.",
        "a.z -> c.u: component must be one of a, b, got 'c'.",
        "b.u -> a.u: must go from an output to an input, but b.u is of causality input.",
        "a.y -> b.v: b has no variable 'v'. Its inputs: u.",
        "parameter 'a.w': a has no variable 'w'. Its parameters: T, y_0, tolerance, solver.",
    ]
    with pytest.raises(UsageError, match="component: expected a name of letters, digits, spaces and _"):
        vdfmu.connect({"a.b": Lag})
    with pytest.raises(UsageError, match="components must be at least one"):
        vdfmu.connect({})
    with pytest.raises(UsageError, match=r"f.y -> arm.tau: lengths must be equal, got 1 and 2\. Connect elements"):
        vdfmu.connect({"f": Lag, "arm": "plant"}, {"f.y": "arm.tau"}, robot="planar_2dof")
    mismatch = r"arm\.q\[1\] -> arm\.tau\[1\]: unit mismatch, 'rad' .*\. Connect signals of one quantity, or put"
    with pytest.raises(SspError, match=mismatch):
        vdfmu.connect({"arm": "plant"}, {"arm.q": "arm.tau"}, robot="planar_2dof")


def test_one_fmu_is_a_system_whose_instance_keeps_its_components_and_files(fmus):
    with vdfmu.load(fmus["2.0"]).instance(parameters={"lag_2.u": 2.0}) as instance:
        ends = [instance.run(stop=0.2, step=0.01, parameters={"lag_2.T": T})["lag_2.y"][-1] for T in (0.1, 0.2)]
    assert ends == pytest.approx([2.0 * (1.0 - math.exp(-0.2 / T)) for T in (0.1, 0.2)], abs=2e-6)  # 1e-6 of a solver


def test_a_state_that_is_set_names_its_start_value(fmus):
    system = vdfmu.connect({"a": fmus["2.0"]})
    with pytest.raises(UsageError, match=r"'a\.y': is not settable: .*\. Set its start value, y_0\.$"):
        system.run(parameters={"a.y": 1.0})
    with pytest.raises(UsageError, match=r"'arm\.q': is not settable: .*\. Set its start value, q_0\[1\]\.$"):
        vdfmu.connect({"arm": "plant"}, robot="planar_2dof").run(parameters={"arm.q": 0.5})


def test_a_package_is_replaced_by_the_same_call(fmus, tmp_path):
    system = vdfmu.connect({"a": fmus["2.0"]})
    assert system.write(tmp_path / "a.ssp").read_bytes() == system.write(tmp_path / "a.ssp").read_bytes()


@pytest.mark.heavy
def test_a_sweep_takes_the_values_and_options_of_the_system(fmus, tmp_path):
    system = vdfmu.connect({"a": fmus["2.0"]}, stop=0.2, step=0.01)
    swept = system.sweep({"a.T": [0.1, 0.2]}, parameters={"a.u": 2.0}, measure=["end=final(a.y)"], out=tmp_path)
    # the step response of a lag to 1e-6 of its solver
    assert swept["end"] == pytest.approx([2.0 * (1.0 - math.exp(-0.2 / T)) for T in (0.1, 0.2)], abs=2e-6)
    assert repr(swept) == f"Study {tmp_path}: 2 points; axes a.T; measures end"


def test_a_notebook_shows_diagram_and_contents_and_other_processes_get_the_results(fmus):
    system = vdfmu.connect({"a": fmus["2.0"], "b": fmus["3.0"]}, {"a.y": "b.u"}, stop=0.1, step=0.01)
    results = system.run(parameters={"a.u": 2.0})
    html = results._repr_html_()
    assert 'data-signal="a.y" data-ends="b.u"' in html and "<td>b.y</td>" in html
    assert not re.search(r"(src|href)=|url\(|<script", html)  # nothing is loaded
    assert 'data-signal="a.y"' in system._repr_html_()
    read = pickle.loads(pickle.dumps(results))
    assert np.array_equal(read["b.y"], results["b.y"]) and "<td>b.y</td>" in read._repr_html_()
    results.summary["verdict"] = verdict_of([Check("x", "X", DOUBTFUL, "the <b> is late")])
    assert "<strong>! Doubtful: the &lt;b&gt; is late</strong>" in results._repr_html_()


@pytest.mark.heavy
def test_a_scenario_is_a_system(tmp_path):
    system = vdfmu.load("planar_tracking")
    assert "plant.tau_s" in {name.partition("[")[0] for name in system.outputs}
    assert system.run(stop=0.01).summary["steps"] == 10
    assert system.check(run=False).problems == []
    with pytest.raises(UsageError, match=r"path must end in \.ssp"):
        system.write(tmp_path / "x.zip")
