"""Tuning from end to end: better values within what is required, the same ones after a stop, all runs kept."""

import dataclasses
import html
import json
import os
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from tests.compiler.unit.motor import write_motor
from tests.conftest import ran
from tests.study.sweeps.conftest import table
from vdfmu.base.errors import UsageError
from vdfmu.extras.tune.problem import Score, SpentError
from vdfmu.extras.tune.search import search, tune
from vdfmu.study.analysis.loops import run_along
from vdfmu.study.sweeps.sweep import Sweep
from vdfmu.system.scenario import load_scenario

ERRORS = "rms(trajectory.q_d - plant.q)"
SPREAD = {"plant.mass": "*lin(0.9, 1.1)"}
SHORT = {"stop": 0.3, "spread": SPREAD, "spread_points": 2, "workers": 2}
SEARCH = {"method": "local", "evaluations": 30}
GAINS = ["controller.K_p", "controller.K_v"]
MARGIN = 0.7


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Gains of the planar arm with a margin, which is 0.8 at its own."""
    folder = tmp_path_factory.mktemp("tuned") / "search"
    return tune("planar_tracking", GAINS, ERRORS, margin=MARGIN, out=folder, **SEARCH, **SHORT)


@pytest.mark.heavy
def test_each_joint_is_better_with_the_margin(tuned):
    assert tuned.after.feasible
    # less by far more than the accuracy of a run, 1e-7 of 1 rad or N.m at errors of 1e-5 rad
    assert (tuned.after.cost < 0.95 * tuned.before.cost).all()
    scenario = dataclasses.replace(load_scenario("planar_tracking"), stop=0.3)
    settings = {name: value.tolist() for name, value in tuned.parameters.items()}
    for point, gains in ((tuned.before, {}), (tuned.after, settings)):
        with run_along(scenario, parameters=gains) as (poses, _, _):
            # at the states of a run with these gains instead of the first ones: errors are some 1e-5 rad in either
            np.testing.assert_allclose(point.modulus, poses.loops.modulus, rtol=0.02)
    assert (tuned.after.modulus >= MARGIN).all()
    assert tuned.margins[1].rate < 0.0


@pytest.mark.heavy
def test_a_function_of_a_script_is_a_cost(tmp_path):
    search = tune(
        "planar_tracking", ["controller.K_p"], lambda results: float(np.abs(results["controller.tau"]).max()),
        limit={"far": lambda results: float(results["plant.q[1]"].max() - 100.0)}, together=True, method="global",
        evaluations=2, stop=0.05, workers=1, out=tmp_path / "search",
    )  # fmt: skip
    assert search.after.feasible and search.after.cost[0] <= search.before.cost[0] < np.inf


@pytest.mark.heavy
def test_all_runs_are_kept(tuned):
    runs = Sweep(tuned.folder)
    assert len(runs) == 2 * tuned.evaluations and not runs.failed
    assert runs["point"].tolist() == list(range(len(runs)))
    assert set(runs["robot"]) == {0.0, 1.0}
    assert runs["controller.K_p[1]"][0] == 1500.0
    comparison = json.loads((tuned.folder / "tune.json").read_text())["comparison"]
    assert {row["name"] for row in comparison} >= {"cost[2]", "error[1]", "peak_torque[2]", "modulus[1]", "delay[2]"}


SCRIPT = """
import sys
from vdfmu.extras.tune import tune
tune("planar_tracking", eval(sys.argv[1]), sys.argv[2], **eval(sys.argv[3]))
"""


@pytest.mark.heavy
def test_a_search_that_is_killed_goes_on_to_the_same_result(tuned, tmp_path):
    """By SIGKILL, four times: no run is lost or doubled, and table and result are those of an undisturbed search."""
    folder, options = tmp_path / "search", {**SHORT, **SEARCH, "margin": MARGIN}
    options["out"] = str(folder)
    for runs in (2, 11, 24, 40):
        process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, repr(GAINS), ERRORS, repr(options)], stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        while process.poll() is None and len(list(folder.glob("parts/part_*.parquet"))) < runs:
            time.sleep(0.01)
        assert process.poll() is None, f"it ended before {runs} files of runs were there"
        os.killpg(process.pid, signal.SIGKILL)
        process.wait(60)
    search = tune("planar_tracking", GAINS, ERRORS, **options)
    assert table(Sweep(folder)) == table(Sweep(tuned.folder))
    np.testing.assert_array_equal(search.after.values, tuned.after.values)
    for name in ("tuned.toml", "tune.json"):
        assert (folder / name).read_bytes() == (tuned.folder / name).read_bytes()


@pytest.mark.heavy
def test_a_start_without_margin_is_noted(tmp_path):
    """The loops of tracking have modes that grow with one sample of delay."""
    search = tune(
        "tracking",
        ["controller.K_p[1]"],
        ERRORS,
        stop=2.6,
        margin="same",
        algorithm="jacobi",
        evaluations=1,
        out=tmp_path,
    )
    first, second, *_ = search.notes
    assert first == "margin: a mode grows at the start, so 'same' requires that none grows faster."
    assert second.startswith("joint 6 is unstable from 0.3") and search.after.feasible


@pytest.mark.heavy
def test_runs_that_fail_cost_infinity_and_limits_hold_for_every_robot(tmp_path):
    """Velocity gains of up to a hundredfold destabilise the sampled loop; the search stays where it runs."""
    search = tune(
        "planar_tracking", {"controller.K_v[1]": "*log(0.5, 200)"}, f"worst({ERRORS})", method="global", evaluations=8,
        out=tmp_path / "search", stop=0.5, workers=2,
    )  # fmt: skip
    assert search.failed == len(Sweep(search.folder).failed) > 0
    assert search.after.feasible and search.after.cost[0] <= search.before.cost[0]
    search = tune(
        "planar_tracking", ["controller.K_p[2]=log(100, 5000)"], "rms(trajectory.q_d[2] - plant.q[2])",
        limit=["peak(controller.tau_e[2]) < 0.0"], method="global", evaluations=8, out=tmp_path / "limited", **SHORT,
    )  # fmt: skip
    assert not search.after.feasible  # no feedback torque at all
    assert any("no values within the limits" in note for note in search.notes)


@pytest.mark.heavy
def test_the_command_shows_before_and_after(tmp_path):
    words = ["tune", "planar_tracking", "--vary", "controller.K_p[1]", "--cost", ERRORS, "--evaluations", "3"]
    result = ran(*words, "--stop", "0.1", "--method", "local", "--out", tmp_path / "search")
    assert re.search(r"peak_error\[1\]\s+\S+\s+\S+\s+rad", result.output)
    assert "[controller]\nK_p = [" in result.output
    study = Sweep(tmp_path / "search")
    headline = study.answer.verdict["headline"]
    assert result.output.splitlines()[0].split(" ", 1)[1] == headline
    assert study.answer.sentences[0] in html.unescape((tmp_path / "search" / "report.html").read_text("utf-8"))
    assert study.search and study.search.start == {0}


@pytest.mark.parametrize(("options", "words"), [
    ({"vary": ["controller.K_x"]}, "controller.K_x: controller has no K_x"),
    ({"vary": ["controller.K_p=normal(1, 2)"]}, "expected lin.FROM, TO. or log.FROM, TO."),
    ({"vary": ["controller.K_p[1]=log(1, 10)"]}, r"expected a range that has the scenario's 1500, got 1 to 10"),
    ({"vary": ["trajectory.t_start"]}, "trajectory.t_start: expected a range, got 0 to 0"),  # a start value
    ({"vary": ["feedforward.F_e_d"]}, "feedforward.F_e_d.1.: expected a range, got 0 to 0"),
    ({"vary": ["plant.mass"], "margin": 0.5}, "the parameters to vary must not belong to the plant"),
    ({"vary": ["controller.K_p", "controller.K_p[1]"]}, "expected each number once, got controller.K_p.1."),
    ({"limit": ["peak(plant.q)"]}, "limit: expected EXPRESSION < NUMBER"),
    ({"margin": "big"}, "margin: expected a modulus margin from 0 to below 1, or same, got big"),
    ({"method": "best"}, "method: expected both, global, local, got best"),
    ({"combine": "all"}, "combine: expected mean or worst, got all"),
    ({"evaluations": 0}, "evaluations: expected at least 1, got 0"),
    ({"time_limit": -1.0}, "time_limit must be a positive, finite time in s, got -1"),
    ({"vary": ["controller.tau_max"]}, r"tau_max.1.: expected a finite number to vary, got 1000000000000"),
    ({"spread": ["algorithm=jacobi, iterative"]}, "spread: expected parameters with numbers, got algorithm"),
    ({"spread": ["feedforward.mode=vdc, inverse"]}, "spread: expected parameters with numbers, got feedf"),
    ({"spread": ["controller.K_p=*lin(0.9, 1.1)"]}, r"K_p.1.: has no effect, because controller.K_p comes after it"),
    ({"cost": "rms(plant.x)"}, "no output or connected input is called plant.x"),
])  # fmt: skip
def test_what_is_wrong_is_said_before_the_first_run(options, words, tmp_path):
    arguments = {"vary": GAINS, "cost": ERRORS, "out": tmp_path / "search", "stop": 0.1, **options}
    with pytest.raises(UsageError, match=words):
        tune("planar_tracking", **arguments)
    assert not (tmp_path / "search").exists()


class Bowl:
    """Evaluations of a cost that is least at 0.9, 0.9, beyond a limit on the sum of both values."""

    def __init__(self, budget):
        self.budget, self.scores, self.missed = budget, [], 0
        self.problem = SimpleNamespace(
            start=np.array([0.2, 0.2]), poses=None, margin=np.zeros(0), loops=lambda values: None,
            values=lambda u: u, place=lambda values: values,
        )  # fmt: skip

    def scores_of(self, several, always=False):
        """Return a score for each of the values, as far as the budget goes."""
        made = []
        for values in several:
            if len(self.scores) == self.budget:
                raise SpentError
            cost, over = np.array([0.1 + np.sum((values - 0.9) ** 2)]), np.array([np.sum(values) - 1.0])
            self.scores.append(Score(values, len(self.scores), cost, 0, over, np.zeros(0), {}))
            made.append(self.scores[-1])
        return made


@pytest.mark.parametrize("method", ["global", "local", "both"])
def test_the_best_values_are_within_the_limits_also_where_others_cost_less(method):
    bowl = Bowl(120)
    start, best = search(bowl, method, seed=1)
    assert any(score.cost[0] < best.cost[0] for score in bowl.scores if not score.feasible)  # the search went beyond
    assert best.feasible and best.values.sum() <= 1.0
    # the least within the limit is at 0.5, 0.5: 0.1 + 2 * 0.4^2. A twentieth of the way there is left at most
    assert best.cost[0] < 0.42 + 0.05 * (start.cost[0] - 0.42)


@pytest.mark.heavy
@pytest.mark.parametrize("margin", [("--margin", "0.5"), pytest.param((), marks=pytest.mark.heavy)])
def test_a_system_without_a_robot_is_tuned(tmp_path, monkeypatch, margin):
    """Its loop is opened at the input that cuts it."""
    monkeypatch.chdir(tmp_path)
    write_motor(tmp_path)
    done = ran(
        "tune", "motor.toml", "--vary", "controller.K_p=lin(0.02,0.2)", "--cost", "peak(motor.w)", "--evaluations", "4",
        *margin,
    )  # fmt: skip
    assert "obot" not in done.output
