"""What a run writes, and what becomes of it when something fails."""

import json
import math
from importlib import import_module

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import CosimError, ModelError, UsageError
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run import Results, simulate
from vdfmu.study.report.sheets import reference_sheet, sheets
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.reference.reference import BLOCK, Reference


def test_a_run_writes_results_summary_package_and_every_connected_output_with_its_unit(planar_run):
    folder, results = planar_run
    names = {path.name for path in folder.iterdir()}
    assert {"results.csv", "summary.json", "system.ssp"} <= names
    assert json.loads((folder / "summary.json").read_text()) == json.loads(json.dumps(results.summary))
    read = Results.read(folder / "results.csv")
    system = load_ssp(folder / "system.ssp")
    assert {".".join(c.start) for c in system.connections} <= set(read.names)
    assert not {".".join(c.end) for c in system.connections} & set(read.names)
    assert read.units["plant.q[1]"] == "rad"
    assert read.units["controller.tau[2]"] == "N.m"
    np.testing.assert_array_equal(read["plant.q[1]"], results["plant.q[1]"])
    assert len(read.time) == 201
    assert read.time[-1] == 0.2


def test_the_summary_holds_the_errors_of_the_recorded_signals_and_against_both_references(planar_run):
    _, results = planar_run
    summary = results.summary
    error = np.degrees(results["trajectory.q_d"] - results["plant.q"])
    torque = 100.0 * (results["controller.tau"] - results["feedforward.tau_m"])  # ell is 100
    # the same sums of squares in another order: equal to some units of rounding
    assert summary["rms_position_error_deg"] == pytest.approx(np.sqrt((error**2).mean(axis=0)), rel=1e-12)
    assert summary["max_position_error_deg"] == pytest.approx(np.abs(error).max(axis=0), rel=1e-12)
    assert summary["rms_torque_compensation_error_nm"] == pytest.approx(np.sqrt((torque**2).mean(axis=0)), rel=1e-9)
    assert summary["real_time_factor"] == pytest.approx(0.2 / summary["wall_s"])
    compared = summary["reference"]
    assert compared["sampled"]["name"] == "sampled"
    # 1e-7 rad and 1e-4 N.m hold at the scenario's tolerance 1e-7 too: errors there scale with the tolerance
    assert compared["sampled"]["max_position_difference_rad"] < 1e-7
    assert compared["sampled"]["max_torque_difference_nm"] < 1e-4
    # the held input is first order in the step: far above the sampled difference, far below the motion
    assert 1e-7 < compared["continuous"]["max_position_difference_rad"] < 1e-3


def with_references(monkeypatch, folder, change):
    """Put a co-simulation with other parameters in the place of scipy's references, which take minutes of split."""

    def reference(name, description, *, step, stop, groups, progress, substeps, overlap):
        scenario, values = description.scenario, description.values
        package = write_ssp(scenario, cached_fmus(scenario, folder), folder / "reference.ssp", values)
        parameters = {key: factor * values["plant"][key.partition(".")[2]] for key, factor in change.items()}
        r = simulate(package, start=0.0, stop=stop, step=step, algorithm="gauss-seidel", parameters=parameters)
        signals = {key: r[key] for key in ("plant.q", "controller.tau", "feedforward.tau_m")}
        for first in range(0, len(r), BLOCK):
            rows = slice(max(first - overlap, 0), first + BLOCK)
            yield Reference(name, r.time[rows], {key: array[rows] for key, array in signals.items()})

    monkeypatch.setattr(import_module("vdfmu.study.run.references"), "reference_blocks", reference)


@pytest.mark.heavy
def test_a_chaotic_loop_is_compared_by_its_statistics_and_a_fault_shown_as_one(tmp_path, monkeypatch):
    with_references(monkeypatch, tmp_path, {f"plant.I_m[{i}]": 1.0 + 1e-9 for i in range(1, 7)})
    summary = vdfmu.run("tracking_split", out=False).summary
    assert summary["friction"] == "split"
    compared = summary["reference"]["sampled"]
    # Both solutions are as good; after 2 s they have nothing in common but the size of their oscillation, 1e-3 rad.
    assert compared["max_position_difference_rad"] > 1e-4
    assert summary["separation"]["max_position_difference_rad"] > 1e-4
    # RMS over 10 s of oscillations that stay alike for some 0.2 s: 1/sqrt(50) of their scatter of 0.2; twice that
    assert 0.0 < compared["rms_position_difference"] < 0.06
    assert 0.0 < compared["rms_torque_difference"] < 0.06
    said = reference_sheet(summary)
    assert said.columns[1] == "Position RMS\n[%]" and "chaotic" in " ".join(said.notes)
    with_references(monkeypatch, tmp_path, {"plant.mass[2]": 1.01, "plant.mass[3]": 1.01, "plant.mass[5]": 1.01})
    summary = vdfmu.run("tracking", out=False, stop=2.0).summary
    assert summary["reference"]["sampled"]["max_position_difference_rad"] > 1e-6
    assert "separation" not in summary and "rms_position_difference" not in summary["reference"]["sampled"]
    assert reference_sheet(summary).columns[1] == "Position\n[rad]"


def test_a_unit_that_fails_leaves_the_rows_before_and_the_reason(tmp_path):
    # a proportional gain of 1e9 drives the arm beyond what any solver step can follow
    with pytest.raises(CosimError, match=r"plant failed at t = .* s in doStep: .*(local error|not finite)") as caught:
        vdfmu.run("planar_tracking", out=tmp_path, parameters={"controller.K_p": 1e9})
    rows = Results.read(tmp_path / "partial" / "results.csv")
    assert len(rows.time) >= 1
    assert rows.time[-1] == pytest.approx(caught.value.time)
    summary = json.loads((tmp_path / "partial" / "summary.json").read_text())
    assert "plant failed at t = 0.003 s in doStep" in summary["error"]
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.heavy
def test_files_of_an_earlier_run_are_replaced_and_nothing_else(tmp_path):
    options = {"out": tmp_path, "stop": 0.01, "reference": False}
    vdfmu.run("planar_tracking", **options)
    old = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "figure_10.png").write_bytes(b"mine")
    with pytest.raises(UsageError, match="only parameters and free inputs can be set"):
        vdfmu.run("planar_tracking", out=tmp_path, parameters={"plant.q": 1})
    with pytest.raises(UsageError, match=r"got figure_10\.png, not written by vdfmu\. .*--overwrite"):
        vdfmu.run("planar_tracking", **options)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.name in old} == old
    (tmp_path / "figure_10.png").rename(tmp_path / "holiday.png")
    vdfmu.run("planar_tracking", parameters={"controller.K_p": 900}, **options)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "holiday.png").read_bytes() == b"mine"
    new = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.name not in ("notes.txt", "holiday.png")}
    assert set(new) == set(old)
    assert new["results.csv"] != old["results.csv"]


@pytest.mark.heavy
def test_rows_of_a_failed_run_are_replaced_by_those_of_the_next_failed_one_only(tmp_path):
    options = {"out": tmp_path, "stop": 0.05, "reference": False}
    for gain in (1e9, 1e8):
        with pytest.raises(CosimError) as caught:
            vdfmu.run("planar_tracking", parameters={"controller.K_p": gain}, **options)
        rows = len(Results.read(tmp_path / "partial" / "results.csv"))
        assert rows == len(caught.value.results)
        unstable, kept = caught.value.__notes__
        assert unstable.startswith("Stability: Unstable from the start, joint")
        assert kept.endswith(f" are in {tmp_path / 'partial' / 'results.csv'}.")
    vdfmu.run("planar_tracking", **options)
    assert len(Results.read(tmp_path / "partial" / "results.csv")) == rows
    assert [p.name for p in tmp_path.iterdir() if p.is_dir()] == ["partial"]


@pytest.mark.parametrize(("options", "words"), [
    ({"step": 0.0}, "step: expected a positive finite time, got 0 s"),
    ({"step": math.nan}, "step: expected a positive finite time, got nan s"),
    ({"stop": -1.0}, "stop: expected a positive finite time, got -1 s"),
    ({"step": 0.003}, "stop: expected a multiple of step = 0.003 s, got 2 s. The nearest is 2.001 s"),
    ({"algorithm": "gauss"}, "algorithm: expected gauss-seidel, jacobi, extrapolated or iterative, got 'gauss'"),
    ({"robot": "manipulator_7dof"}, "manipulator_7dof"),
])  # fmt: skip
def test_a_wrong_option_is_refused_before_anything_is_built(tmp_path, options, words):
    with pytest.raises((UsageError, ModelError), match=words.replace(".", r"\.")):
        vdfmu.run("planar_tracking", out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_hold_results_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot hold the results.*--out"):
        vdfmu.run("planar_tracking", out=tmp_path / "file" / "results")


@pytest.mark.heavy
def test_the_estimation_scenario_shows_both_estimates_on_the_plants_own_signals(tmp_path):
    results = vdfmu.run("estimation", stop=0.5, reference=False, backend="python", out=tmp_path)
    summary = results.summary
    # kappa - q cancels: 1e-16 of positions below 1 rad, over compliances of 1e-5 rad/(N m) and more.
    assert max(summary["rms_tau_s_hat_error_nm"]) < 1e-10
    # At this speed friction alone is 0.3 N m at a wrist and more, over ratio and stiffnesses of about 1.
    assert min(summary["rms_tau_f_hat_error_nm"]) > 0.01
    assert "Consistent" in "".join(heading for sheet in sheets(summary) for heading in sheet.columns)
    for unknown in ("tracking", "planar_tracking"):
        with pytest.raises(UsageError, match=r"estimator\.tau_hat_max: expected .* a component of trajectory"):
            vdfmu.run(unknown, parameters={"estimator.tau_hat_max": 1.0}, out=tmp_path)
