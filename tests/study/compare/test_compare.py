"""A comparison is fair, goes on where it stopped, and each cell is a plain run."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import number, show
from tests.study.sweeps.conftest import table
from vdfmu.base.errors import UnitError, UsageError, VdfmuError
from vdfmu.base.once import one_job
from vdfmu.base.option import declared
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.compare import compare as module
from vdfmu.study.compare.axes import LAWS, MISMATCHES, MOTIONS
from vdfmu.study.compare.cells import STRUCTURES, ComparedArm
from vdfmu.study.compare.compare import compare
from vdfmu.study.compare.measures import MEASURES, OfRun
from vdfmu.study.compare.page import LawComparison, in_words, ranked
from vdfmu.study.options import CompareOptions
from vdfmu.study.sweeps.job import Bench, Job
from vdfmu.study.sweeps.measures import read_measures
from vdfmu.study.sweeps.plan import of_scenario
from vdfmu.study.tuning.problem import make_problem
from vdfmu.system.scenario.replace import with_units

SMALL = {
    "arms": ["planar_2dof"], "laws": ["controller", "disturbance_observer"], "motions": ["point_to_point"],
    "mismatches": ["none", "masses", "torque_noise", "delay_1", "encoder", "encoder_delay"],
    "evaluations": 6, "repeats": 2, "seed": 3, "workers": 2,
}  # fmt: skip


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Two laws of the planar arm, one of them with sampled states."""
    return compare(**SMALL, out=tmp_path_factory.mktemp("compare") / "small")


def test_every_law_is_tuned_by_the_same_search(monkeypatch, tmp_path):
    """As many evaluations, one seed, one cost and one limit of the margin, on one scenario."""
    asked = []

    def tune(scenario, vary, cost, **options):
        asked.append((scenario, vary, cost, options))
        raise InterruptedError

    monkeypatch.setattr(module, "tune", tune)
    for law in LAWS:
        with pytest.raises(InterruptedError):
            compare(arms=["planar_2dof"], laws=[law], evaluations=7, seed=5, out=tmp_path)
    assert len(asked) == len(LAWS)
    for scenario, vary, cost, options in asked:
        margin = options["limit"]["margin"]
        assert (scenario, cost.name, margin.name, margin.least) == (tmp_path / "planar_2dof/tuning.toml", "rms_tool",
                                                                     "margin", 0.5)  # fmt: skip
        assert (options["evaluations"], options["seed"], options["method"]) == (7, 5, "global")
        assert all(form.startswith("*log(") for form in vary.values())


def test_a_law_that_is_not_tuned_is_named_and_not_in_the_table(monkeypatch, tmp_path):
    def tune(scenario, vary, cost, **options):
        raise UnitError("no gains")

    monkeypatch.setattr(module, "tune", tune)
    with pytest.raises(VdfmuError, match="no law is tuned:\nplanar_2dof: controller: no gains"):
        compare(arms=["planar_2dof"], laws=["controller"], out=tmp_path)


@one_job()
def test_every_law_has_what_is_varied_and_a_start(tmp_path):
    arm = ComparedArm("planar_2dof", tmp_path)
    for name, law in LAWS.items():
        started = arm.started(law)
        scenario = with_units(vdfmu.load_scenario(arm.tuning), {"controller": law.searched or law.unit})
        known = {v.group for v in scenario.resolved.tables["controller"] if v.causality == "parameter"}
        assert {f"controller.{one}" for one in law.vary} <= started.keys(), name
        assert {one.partition(".")[2] for one in started if one.startswith("controller.")} <= known, name
        assert {*law.vary, *law.kept} <= known, name
        assert all(low < 1.0 < high for low, high in law.vary.values()), name


@one_job()
@pytest.mark.parametrize("structure", STRUCTURES)
def test_every_input_of_a_law_is_connected_in_each_structure(structure, tmp_path):
    arm = ComparedArm("planar_2dof", tmp_path)
    for law in LAWS.values():
        scenario = vdfmu.load_scenario(arm.write("point_to_point", law, {}, structure))
        fed = scenario.system.fed
        free = [v.group for v in scenario.resolved.tables["controller"] if v.causality == "input"]
        assert all(f"controller.{group}" in fed for group in free), law
        measured = {s for s, targets in scenario.system.connections.items() if any("controller." in t for t in targets)}
        if structure == "sensed":
            assert not measured & {"plant.q", "plant.q_dot", "plant.kappa", "plant.kappa_dot"}
        assert ("controller.tau" in scenario.system.connections) and (
            ("plant.tau" in scenario.system.connections["controller.tau"]) == (structure != "driven")
        )


@one_job()
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_law_does_not_know_of_a_mismatch(motion, tmp_path):
    """All settings are of the plant, or of what is between it and the law."""
    arm = ComparedArm("planar_2dof", tmp_path)
    for name, mismatch in MISMATCHES.items():
        scenario = vdfmu.load_scenario(arm.write(motion, LAWS["controller"], {}, mismatch.structure))
        found = arm.differences(scenario, mismatch, 4)
        assert {one.partition(".")[0] for one in found} <= {
            "plant", "noise", "communication", "link_encoder", "motor_encoder"
        }, name  # fmt: skip
        mass = [found.get(f"plant.mass[{i}]") for i in (1, 2)]
        assert mass == ([1.2 * m for m in arm.robot.mass] if name == "masses" else [None, None])
        assert found["plant.payload_mass"] == pytest.approx(mismatch.payload * arm.robot.mass.sum())  # one rounding
        assert found.get("noise.seed", 4.0) == 4.0


def test_unknown_names_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UsageError, match=r"laws: expected controller, .*, got pd_gravty; did you mean pd_gravity\?"):
        compare(laws=["pd_gravty"], out=tmp_path / "none")
    with pytest.raises(UsageError, match="evaluations: expected at least 1, got 0."):
        compare(evaluations=0, out=tmp_path / "none")
    with pytest.raises(
        UsageError, match=r"laws: iterative_learning learns over repeated cycles, .*\narms: no robot 'ur5'"
    ):
        compare(laws=["iterative_learning"], arms=["ur5"], out=tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("margin", [float("nan"), 0.0, -0.2, 1.0])
def test_a_margin_that_no_loop_has_or_all_have_is_refused(margin, tmp_path):
    with pytest.raises(UsageError, match=f"margin: expected a number above 0 and below 1, got {margin:g}"):
        compare(margin=margin, out=tmp_path / "none")


def test_no_name_does_not_mean_all(tmp_path):
    """As of a script whose variable is empty: ``--laws "$LAWS"``."""
    read = {one.name: one.option.read for one in declared(CompareOptions)}["laws"]
    assert read is not None and read("") == [] and read(None) is None
    for axis in ("laws", "motions", "mismatches", "arms"):
        with pytest.raises(UsageError, match=f"{axis}: expected at least one, got none"):
            compare(**{axis: []}, out=tmp_path / "none")


def test_twins_are_refused(tmp_path):
    for axis, name in (("laws", "controller"), ("motions", "circle"), ("mismatches", "none")):
        with pytest.raises(UsageError, match=f"{axis}: expected each once, got {name} 2 times."):
            compare(**{axis: [name, name]}, out=tmp_path / "none")
    for arms in (["planar_2dof"] * 2, [str(tmp_path / "a/arm.toml"), str(tmp_path / "b/arm.toml")]):
        with pytest.raises(
            UsageError, match="arms: expected one of each name, got .*, all of which are (planar_2|arm)"
        ):
            compare(arms=arms, out=tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        ({}, "stable"), ({"modulus": 0.0}, "no margin"), ({"modulus": 0.0, "limited": 0.5}, "at limits"),
        ({"modulus": 0.0, "unstable": 1.0}, "unstable"), ({"peak_tool": 1.0}, "off the path"),
        ({"unstable": np.nan}, "not judged"), ({"unstable": np.nan, "peak_tool": 1.0}, "off the path"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mismatch", ["none", "encoder_delay"])
def test_a_cell_without_margin_has_a_verdict_of_its_own_also_behind_encoders(mismatch, found, verdict):
    row = dict.fromkeys(MEASURES, 0.1) | {f"{name}[{i}]": 0.0 for name in ("crossing", "place") for i in (1, 2, 3)}
    row |= {"motion": "circle", "mismatch": mismatch, "failed": None, "failed_at": None, "wall_s": 1.0}
    row |= {"limited": 0.0, "unstable": 0.0, "peak_tool": 0.01} | found
    cell = module._cell(SimpleNamespace(length=1.0), [row])
    assert (cell["verdict"], cell["modulus"]) == (verdict, found.get("modulus", 0.1))


def words_of(errors):
    """Return a study with errors [m] of laws, by arm; None where a cell is unstable."""
    laws, arms = list(errors), [str(k) for k in range(len(next(iter(errors.values()))))]
    rows = [
        {"law": law, "arm": arm, "motion": "circle", "mismatch": "none", "rms_tool": error or np.nan,
         "verdict": "stable" if error else "unstable"}
        for law, each in errors.items() for arm, error in zip(arms, each, strict=True)
    ]  # fmt: skip
    tunings = {arm: {law: {"why_not": "", "before": 1.0, "after": 1.0, "step_us": 1.0} for law in laws} for arm in arms}
    about = {"arms": arms, "motions": ["circle"], "mismatches": ["none"], "laws": laws, "budget": 1, "seed": 0,
             "margin": 0.5, "delayed": False, "cost": "rms_tool", "tunings": tunings}  # fmt: skip

    class Study(SimpleNamespace):
        __len__ = lambda self: len(self.rows)  # noqa: E731

    return Study(rows=rows, about=about)


def test_two_laws_are_compared_over_the_cells_that_both_have():
    """A law that fails in the hard cell gains nothing by it, and one that fails in the easy one loses nothing."""
    study = words_of({"controller": [1e-3, 1e-1, None], "pd_gravity": [None, 2e-1, 4e-3],
                      "computed_torque": [5e-4, None, None]})  # fmt: skip
    order = {one.law: one for one in ranked(study, "none")}
    assert [one.broken for one in order.values()] == [1, 1, 2]
    # of geometric means of one ratio each: the rounding of a logarithm and its exponential
    assert [one.mean for one in order.values()] == pytest.approx([1.0, 2.0, 0.5], rel=1e-14)
    assert "`controller`; stable in all but 1 cell; 2 times less RMS tool error than `pd_gravity`" in in_words(study)


def test_errors_below_a_micrometre_are_equally_good():
    study = words_of({"controller": [1e-9], "pd_gravity": [9e-7], "computed_torque": [1e-5]})
    assert "knows: `controller` or `pd_gravity`; 10 times less" in in_words(study)
    assert "Errors below 1 um are equally good" in in_words(study)


@pytest.mark.heavy
def test_a_factor_varies_all_elements_together(tmp_path):
    """The parameters of values are the start's, times the factor; what follows from them follows."""
    with one_job():
        arm = ComparedArm("planar_2dof", tmp_path)
        law = LAWS["state_feedback"]
        given = {"units": {"controller": law.searched}, "settings": arm.started(law), "together": True}
        problem = make_problem(
            arm.tuning, {"controller.error": "*log(0.1, 10)"}, OfRun("rms_tool", arm.robot, 0), **given
        )
        found = problem.parameters(np.array([2.0]))
        assert problem.names == ["controller.error"] and problem.start.tolist() == [1.0]
        assert found == {"controller.error[1]": 2e-3, "controller.error[2]": 2e-3}
        gains = problem.plan.followed(0, {"controller.error": 2.0})
        tighter = problem.plan.followed(0, {"controller.error": 0.5})
        assert gains["controller.K_q[1,1]"] < tighter["controller.K_q[1,1]"]


@pytest.mark.heavy
@pytest.mark.parametrize("delayed", [False, True])
def test_the_margin_of_the_search_is_that_of_the_loops_along_the_motion(delayed, tmp_path):
    with one_job():
        arm, law = ComparedArm("planar_2dof", tmp_path), LAWS["controller"]
        path = arm.write("point_to_point", law, arm.rule, "plain")
        missing = OfRun("margin", arm.robot, np.zeros(3), delayed=delayed)
        job = Job((of_scenario(path, [], {}, {}),), tuple(read_measures({"margin": missing})), ("*",), ())
        (row,) = Bench(job, tmp_path).run([(0, 0, {})])
        loops = margins_along(path, master="jacobi" if delayed else None).judged.loops
    # jacobi delays each signal: of this controller the torque alone; rounding, and states of a run with this delay,
    # whose errors are some 1e-5 rad
    assert -row["margin"] == pytest.approx(loops.modulus.min(), rel=0.02 if delayed else 1e-9)


@pytest.mark.heavy
def test_the_table_has_all_cells_and_the_laws_had_the_same_number_of_evaluations(small):
    about = small.about
    assert [t["evaluations"] for t in about["tunings"]["planar_2dof"].values()] == [6, 6]
    cells = [(row["law"], row["mismatch"]) for row in small.rows]
    assert sorted(cells) == sorted((law, one) for law in SMALL["laws"] for one in SMALL["mismatches"])
    for row in small.rows:
        assert row["failed"] is None
        # with the delay of encoders a mode of one law grows by 0.3 1/s for a moment
        assert row["verdict"] == "stable" or (row["mismatch"], row["verdict"]) == ("encoder_delay", "no margin")
        assert (row["RT"] > 0.0) == (row["mismatch"] == "torque_noise")  # else runs are the same to the bit
        assert row["modulus"] < 1.0 or row["mismatch"] != "none"
        if row["mismatch"] == "none":
            assert row["modulus"] >= 0.45  # 0.5 of the motion with a push; poses differ little without
    assert (small.folder / "sweep.csv").read_text().count("\n") == 1 + len(small)


@pytest.mark.heavy
def test_the_words_and_the_page_have_the_numbers(small):
    text, page = in_words(small), (small.folder / "report.html").read_text()
    (_, one, first), (_, ratio, second) = ranked(small, "masses")
    value = {row["law"]: row["rms_tool"] for row in small.rows if row["mismatch"] == "masses"}
    assert one == 1.0 and ratio == pytest.approx(value[second] / value[first])  # one cell: the mean is its ratio
    assert f"- Masses and inertias of the links +20 %: `{first}`" in text
    data = json.loads(page.partition('type="application/json">')[2].partition("</script>")[0])["compared"]
    assert len(data["cells"]) == len(small) and data["seed"] == 3
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")


@pytest.mark.heavy
def test_a_cell_of_the_page_shows_its_command(small, browser):
    show(browser, small.folder / "report.html")
    assert browser.run("document.querySelectorAll('.matrix button').length") == len(small)
    (row,) = (r for r in small.rows if (r["law"], r["mismatch"]) == ("controller", "masses"))
    wanted = "[...document.querySelectorAll('.matrix button')].find(b => b.title.startsWith('controller, masses'))"
    browser.run(f"{wanted}.click()")
    assert browser.run("document.querySelector('#cell pre').textContent").endswith(f"--row {row['point']}")
    assert number(browser.run(f"{wanted}.textContent")) == pytest.approx(
        1e3 * row["rms_tool"], rel=6e-3
    )  # three digits
    assert browser.problems == [] and browser.requests == browser.asked


@pytest.mark.heavy
@pytest.mark.parametrize("mismatch", ["masses", "torque_noise"])
def test_a_cell_equals_a_plain_run_to_the_bit(small, mismatch):
    row = next(r for r in small.rows if (r["law"], r["mismatch"]) == ("disturbance_observer", mismatch))
    results = vdfmu.run(**small.options(row["point"]), reference=False, out=False)
    robot = vdfmu.load_robot("planar_2dof")
    for name in ("rms_tool", "peak_tool", "rms_joint", "effort", "torque_noise", "stabilisation", "overshoot"):
        assert OfRun(name, robot, np.zeros(3))(results) == row[name], name


@pytest.mark.heavy
@pytest.mark.parametrize("mismatch", ["encoder", "encoder_delay"])
def test_a_cell_behind_encoders_has_the_verdict_of_its_run(small, mismatch):
    for row in (row for row in small.rows if row["mismatch"] == mismatch):
        loops = vdfmu.run(**small.options(row["point"]), reference=False, out=False).summary["verdict"]["checks"][0]
        assert loops["name"] == "Sampled loops" and loops["passed"]
        words = f"stable with a modulus margin of {row['modulus']:.2g} " if row["modulus"] else "but without a margin"
        assert words in loops["text"] and row["verdict"] == ("stable" if row["modulus"] else "no margin")


@pytest.mark.heavy
def test_another_margin_is_another_tuning(small):
    for other in ({"margin": 0.7}, {"delayed": True}):
        with pytest.raises(UsageError, match=r"tune: holds another study.* differ in functions\."):
            compare(**SMALL, **other, out=small.folder)


@pytest.mark.heavy
def test_what_is_done_stays_done(small, tmp_path, monkeypatch):
    """With all rows of the second law lost, the first is not run again, and the table is the same."""
    folder = tmp_path / "again"
    shutil.copytree(small.folder, folder)
    for name in ("sweep.parquet", "sweep.json"):
        (folder / name).unlink()
    lost = folder / "planar_2dof/disturbance_observer/cells"
    (lost / "sweep.parquet").unlink()
    kept = (folder / "planar_2dof/controller/cells/sweep.parquet").stat().st_mtime_ns
    again = compare(**SMALL, out=folder)
    assert (folder / "planar_2dof/controller/cells/sweep.parquet").stat().st_mtime_ns == kept
    assert {k: v for k, v in table(again).items()} == table(LawComparison(small.folder))
    assert set(MEASURES) <= set(again.columns)
