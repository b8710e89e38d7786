"""Parameter studies from end to end: the same numbers as runs one by one, whatever happens in between."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran, refused
from tests.study.sweeps.conftest import MEASURES, WAYS, study
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.engine.run import simulate
from vdfmu.study.sweeps.sweep import Sweep
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario

MODELS = Path(vdfmu.__file__).parents[1] / "models"
LATE = """from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.units.trajectory import Trajectory

class Late(Trajectory):
    \"\"\"The motion, 0.02 s later.\"\"\"

    def outputs(self) -> None:
        motion = desired_motion(self.t - 0.02, self.q_start, self.q_end, self.T, self.t_start)
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = motion
"""


def test_each_point_is_the_run_of_its_values(tmp_path):
    """To the bit: a reset component computes what a new one does, and each point is a run of its own."""
    axes = {"controller.K_p[2]": "lin(500, 2000, 2)", "plant.mass": "*0.9, 1.1", "algorithm": "jacobi, gauss-seidel"}
    swept = vdfmu.sweep(
        "planar_tracking", axes, stop=0.2, workers=2, out=tmp_path / "study", record=["plant.q[1]"],
        measure={"error": "rms(trajectory.q_d - plant.q)"},
    )  # fmt: skip
    assert len(swept) == 8 and not swept.failed
    assert swept["point"].tolist() == list(range(8))
    scenario = load_scenario("planar_tracking")
    package = write_ssp(scenario, build_fmus(scenario.robot, tmp_path / "fmus", folded=True), tmp_path / "p.ssp")
    rows = swept.table().to_pylist()
    for row in (rows[0], rows[3], rows[6]):
        mass = row["plant.mass"] * scenario.robot.mass
        results = simulate(
            package, stop=0.2, step=1e-3, algorithm=row["algorithm"],
            parameters={"controller.K_p[2]": row["controller.K_p[2]"], "plant.mass": mass.tolist()},
        )  # fmt: skip
        error = results["trajectory.q_d"] - results["plant.q"]
        # of the mean of squares in another order: rounding
        np.testing.assert_allclose([row["error[1]"], row["error[2]"]], np.sqrt(np.mean(error**2, axis=0)), rtol=1e-12)
        np.testing.assert_array_equal(row["plant.q[1]"], results["plant.q[1]"])
        np.testing.assert_array_equal(row["time"], results.time)


@pytest.mark.heavy
def test_robots_motions_and_payloads_vary_together(tmp_path):
    text = (MODELS / "robots" / "planar_2dof.toml").read_text()
    robots = [str(tmp_path / "light.toml"), str(tmp_path / "heavy.toml")]
    for path, mass in zip(robots, ("2.0", "3.0"), strict=True):
        Path(path).write_text(text.replace("mass = 2.0", f"mass = {mass}"))
    (tmp_path / "late.py").write_text(LATE)
    swept = vdfmu.sweep(
        "planar_tracking",
        {
            "robot": robots, "unit:trajectory": ["trajectory", str(tmp_path / "late.py")],
            "plant.payload_mass": "lognormal(0.5, 0.5)", "controller.K_p": "*lin(0.5, 1)",
        },
        sample="lhs", points=6, stop=0.05, out=tmp_path / "study",
    )  # fmt: skip
    assert not swept.failed and np.ptp(swept["plant.payload_mass"]) > 0.1
    rows = swept.table().to_pylist()
    assert len({row["robot"] for row in rows}) == len({row["unit:trajectory"] for row in rows}) == 2
    for row in rows:
        results = vdfmu.run(**swept.options(row["point"]), reference=False, out=False)
        error = results["trajectory.q_d"] - results["plant.q"]
        # of the mean of squares in another order: rounding
        np.testing.assert_allclose([row["error[1]"], row["error[2]"]], np.sqrt(np.mean(error**2, axis=0)), rtol=1e-12)


@pytest.mark.heavy
def test_a_point_that_fails_crashes_or_hangs_is_a_row_with_its_reason(wild, tmp_path):
    ways = ["well", "crash", "well", "leave", "hang", "well"]
    swept = vdfmu.sweep(
        wild, {"unit.way": [WAYS[way] for way in ways]}, measure=MEASURES, parameters={"unit.at": 0.5}, step=0.1,
        workers=1, chunk=6, time_limit=5.0, out=tmp_path / "study",
    )  # fmt: skip
    assert set(swept.failed) == {1, 3, 4}
    assert "SIGSEGV" in swept.failed[1]
    assert "component unit ended the process at t = 0.5 s" in swept.failed[3]
    assert "within 5 s" in swept.failed[4]
    good = np.isfinite(swept["end"])
    assert good.tolist() == [True, False, True, False, False, True]
    assert len(set(swept["end"][good])) == 1


@pytest.mark.heavy
def test_failed_points_are_run_again_on_request(wild, tmp_path):
    trap = tmp_path / "trap.py"
    trap.write_text("import os\ndef end(results):\n    if os.path.exists(os.environ['TRAP']):\n"
                    "        raise ValueError('not now')\n    return results['unit.y'][-1]\n")  # fmt: skip
    sys.path.insert(0, str(tmp_path))
    os.environ["TRAP"] = str(tmp_path / "closed")
    try:
        import trap as module  # pyright: ignore[reportMissingImports]

        axes = {"unit.at": [0.0, 0.5, 1.0]}
        (tmp_path / "closed").touch()
        out = tmp_path / "study"
        first = vdfmu.sweep(wild, axes, measure={"end": module.end}, step=0.1, workers=1, out=out)
        assert list(first.failed.values()) == ["measure end = end: ValueError: not now."] * 3
        (tmp_path / "closed").unlink()
        assert len(vdfmu.sweep(wild, axes, measure={"end": module.end}, step=0.1, out=out).failed) == 3
        again = vdfmu.sweep(wild, axes, measure={"end": module.end}, step=0.1, out=out, retry=True)
        assert not again.failed and len(again) == 3
    finally:
        sys.path.remove(str(tmp_path))
        del os.environ["TRAP"]


@pytest.mark.heavy
def test_a_function_of_a_script_goes_to_the_workers_and_one_that_fails_is_named(wild, tmp_path):
    offset, options = 3.0, {"step": 0.5}
    measure = {"m": lambda results: results["unit.y"][-1] + offset}
    swept = vdfmu.sweep(wild, {"unit.at": [0.0, 1.0]}, measure=measure, out=tmp_path / "study", **options)
    assert not swept.failed and (swept["m"] >= 3.0).all()
    swept = vdfmu.sweep(wild, {"unit.at": [0.0]}, measure={"m": boom}, out=tmp_path / "failed", **options)
    assert swept.failed[0].startswith("measure m = boom: AttributeError: ")


def boom(results):
    return results.missing


@pytest.mark.heavy
def test_provenance_and_columns_are_in_the_file(wild, tmp_path):
    made = study(wild, tmp_path / "study")
    again = Sweep(tmp_path / "study" / "sweep.parquet")
    assert again.facts == made.facts == json.loads((tmp_path / "study" / "sweep.json").read_bytes())
    assert again.facts["n"] == 40 and again.facts["vdfmu"] == vdfmu.__version__
    assert again.axes == ["unit.at"] and again.measures == ["end", "count"]
    # point, axis, failed, failed_at, failed_in, kind, wall_s and two measures
    assert again.to_pandas().shape == (40, 9)
    with pytest.raises(UsageError, match="no column 'ende'; did you mean end"):
        again["ende"]


@pytest.mark.heavy
def test_rows_are_found_by_what_they_measured(tmp_path):
    swept = vdfmu.sweep("planar_tracking", {"controller.K_p": [300.0, 1000.0, 600.0]}, stop=0.2, out=tmp_path / "study")
    assert swept.row("worst")["controller.K_p"] == 300.0
    assert swept.row("best", "error[2]")["controller.K_p"] == 1000.0
    assert swept.row(2)["controller.K_p"] == 600.0
    for which, words in ((7, "a point up to 2"), ("first", "worst, best")):
        with pytest.raises(UsageError, match=words):
            swept.row(which)
    with pytest.raises(UsageError, match="by: expected error"):
        swept.row("worst", "speed")


@pytest.mark.parametrize(("over", "options", "words"), [
    ({"unit.nothing": [1.0]}, {}, "nothing"),
    ({"unit.at": [1.0]}, {"measure": ["m=final(unit.z)"]}, "no output or connected input is called unit.z"),
    ({"unit.at": [1.0]}, {"measure": None}, "measure: expected at least one"),
    ({"unit.at": [1.0]}, {"record": ["x*"]}, "record: no output"),
    ({"unit.at": [1.0]}, {"measure": ["m=at(unit.y, 2)"]}, "a time from 0 to 1 s, got 2 s"),
    ({"unit.at": [1.0]}, {"step": None}, "step: the package does not state it"),
    ({"unit.at": [1.0]}, {"measure": ["m=1 / 0 + final(unit.y)"]}, "ZeroDivisionError"),
    ({"unit.at": [1.0]}, {"workers": 0}, "workers"),
    ({"unit.at": [1.0]}, {"chunk": 0}, "chunk"),
    *(
        ({"unit.at": [1.0]}, {"time_limit": float(limit)}, f"time_limit must be a positive, finite time .* {limit}")
        for limit in ("0", "inf", "nan", "-1")
    ),
    ({"robot": ["planar_2dof"]}, {}, "robot: expected a scenario"),
    ({"unit.at": "*1, 2"}, {}, "unit.at: expected a scenario"),
    ({"algorithm": ["fast"]}, {}, "fast"),
])  # fmt: skip
def test_what_cannot_be_run_is_said_before_the_first_point(wild, tmp_path, over, options, words):
    with pytest.raises(UsageError, match=words):
        vdfmu.sweep(wild, over, **{"measure": MEASURES, "step": 0.1, "out": tmp_path / "study", **options})
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(("over", "words"), [
    (["controller.K_x=1, 2"], "K_x"),
    (["feedforward.mode=vdc, fast"], "fast"),
    (["plant.mass=lin(-1, 1, 3)"], "mass"),
    (["feedforward.mode=*1, 2"], "expected numbers to multiply"),
    (["robot=planar_2dof, nowhere"], "nowhere"),
    (["plant.q_max=1, 2"], r"robot planar_2dof does not have its optional table \[limits\]"),
    (["plant.F_e=*lin(1, 2, 2)"], "not all 0"),
    (["trajectory.t_start=*lin(1, 2, 2)"], "not all 0"),  # its start value: no key of the scenario
    (["controller.K_p[1]=1, 2", "controller.K_p=3, 4"], r"K_p\[1\]: has no effect, because controller.K_p comes"),
])  # fmt: skip
def test_what_a_scenario_cannot_have_is_said_before_the_first_point(tmp_path, over, words):
    with pytest.raises(VdfmuError, match=words):
        vdfmu.sweep("planar_tracking", over, stop=0.1, out=tmp_path / "study")
    assert not (tmp_path / "study").exists()


@pytest.mark.heavy
def test_memory_stays_flat_over_ten_thousand_points(wild, tmp_path):
    """Rows that were kept would be 10,000 of some 1 kB; the tables of pyarrow take some MB at the end."""
    code = f"""
import resource, numpy, vdfmu
seen = {{}}
def look(stage, done, total):
    if stage == "points" and done in (2000, 10000):
        seen[done] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
vdfmu.sweep({str(wild)!r}, {{"unit.at": numpy.linspace(0, 1, 10000)}}, measure={MEASURES}, step=0.5,
            out={str(tmp_path / "study")!r}, progress=look)
print(seen[10000] - seen[2000])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 15.0  # MB


@pytest.mark.heavy
def test_a_row_is_run_again_by_name(tmp_path, monkeypatch):
    """The run of the worst point has its error: of the same FMUs, values and master, so to the rounding of a sum."""
    monkeypatch.chdir(tmp_path)
    over = {"plant.K_f0": "*0.5, 2", "feedforward.mode": "vdc, inverse", "algorithm": ["jacobi", "gauss-seidel"]}
    swept = vdfmu.sweep(
        "planar_tracking", over, stop=0.2, measure={"error": "rms(trajectory.q_d - plant.q)"},
        parameters={"controller.K_p": 800.0},
    )  # fmt: skip
    worst = swept.row("worst")
    ran("run", "--from", "results/sweep_planar_tracking", "--no-reference")
    summary = json.loads(Path("results", "planar_tracking", "summary.json").read_bytes())
    assert summary["algorithm"] == worst["algorithm"] and summary["stop"] == 0.2
    assert summary["parameters"]["controller.K_p"] == "800.0"
    expected = np.degrees([worst["error[1]"], worst["error[2]"]])
    np.testing.assert_allclose(summary["rms_position_error_deg"], expected, rtol=1e-12)
    again = vdfmu.run(**swept.options(3), reference=False, out=False)
    row = swept.row(3)
    np.testing.assert_allclose(np.radians(again.summary["rms_position_error_deg"][0]), row["error[1]"], rtol=1e-12)


@pytest.mark.heavy
def test_a_row_of_a_scenario_that_was_changed_is_run_with_a_note(tmp_path):
    """Settings with a value for each joint are kept as such; what the file says now counts, and is noted."""
    mine = tmp_path / "mine.toml"
    mine.write_text((MODELS / "scenarios" / "planar_tracking.toml").read_text())
    swept = vdfmu.sweep(
        mine, {"plant.mass": "*0.9, 1.1"}, stop=0.1, parameters={"controller.K_p": np.array([900.0, 700.0])},
        out=tmp_path / "study",
    )  # fmt: skip
    options = swept.options(1)
    assert options["parameters"]["controller.K_p"] == [900.0, 700.0] and not swept.notes
    vdfmu.run(**options, reference=False, out=False)
    mine.write_text(mine.read_text().replace("T = 2.0", "T = 3.0"))
    done = ran("run", "--from", swept.folder, "--no-reference", "--out", tmp_path / "again")
    assert "changed since the study" in done.output
    assert "--row goes with --from" in refused("run", "planar_tracking", "--row", "3")
    assert "two_joint: expected no scenario with" in refused("run", "two_joint", "--from", swept.folder)


@pytest.mark.heavy
def test_the_command_says_what_it_found(wild, tmp_path):
    words = ["sweep", str(wild), "--vary", "unit.way=0, 1", "--measure", "end=final(unit.y)", "--step", "0.1"]
    done = ran(*words, "--out", tmp_path / "study")
    assert "1 of 2 points failed: a component crashed the process (SIGSEGV) (1, unit.way 1)" in done.output
    assert "sweep.parquet, report.html; 2 points" in done.output
    assert "TARGET=FORM" in refused("sweep", wild, "--vary", "unit.way")


def test_a_study_that_is_not_there_is_said_and_none_above_it_is_read(tmp_path):
    (tmp_path / "parts").mkdir()  # of a study that has begun
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(UsageError, match=r"none: expected sweep.parquet or sweep.csv of a .*; there is none\.$"):
        Sweep(tmp_path / "none")
