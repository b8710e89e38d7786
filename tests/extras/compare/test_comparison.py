"""The page of several runs: what differs in their settings, and in what they did."""

from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import show
from vdfmu.engine.results.results import Results
from vdfmu.extras.compare.comparison import answer, change, difference_sheet, joint_sheets
from vdfmu.study.report.page import report_page, write_report
from vdfmu.study.report.shown_run import ShownRun, read_run
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    gains = {"controller.K_p": [100.0, 150.0], "controller.K_v[2]": 5.0}
    options: dict = {"reference": False, "stop": 0.2}
    vdfmu.run("planar_tracking", out=folder / "first", **options)
    vdfmu.run("planar_tracking", out=folder / "second", parameters=gains, step=0.002, **options)
    return [folder / "first", folder / "second"]


def sheet_of(folders, without=False):
    runs = [read_run(folder) for folder in folders]
    return difference_sheet(["a", "b"], [run._replace(package=Path("none")) for run in runs] if without else runs)


def test_what_differs_has_the_values_of_both_or_the_settings_and_nothing_else(two):
    was = system_values(load_scenario("planar_tracking"))["controller"]
    rows = {row[0]: row[1:] for row in sheet_of(two).rows}
    assert rows["Step"] == ("0.001 s", "0.002 s", "")
    assert rows["controller.K_p [N.m/rad]"][1] == "100, 150"
    assert rows["controller.K_v[2] [N.m.s/rad]"][1:] == ("5", change(was["K_v[2]"], 5.0))
    assert len(rows) == 3
    assert sheet_of([two[0], two[0]]).notes == ["The settings of the runs are the same."]
    sheet = sheet_of(two, without=True)
    assert [row[0] for row in sheet.rows] == ["Step", "controller.K_p", "controller.K_v[2]"]
    assert sheet.rows[1][1:] == ("as in the scenario", "[100.0, 150.0]")
    assert sheet.notes


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [(2.0, 2.0, "none"), (2.0, 2.0002, "× 1"), (2.0, 2.5, "× 1.25"), (2.0, 1.5, "× 0.75"), (2.0, 8.0, "× 4"),
     (2.0, 0.2, "× 0.1"), (0.0, 1.0, ""), (None, 1.0, "")],
)  # fmt: skip
def test_changes_are_in_per_cent_or_factors(before, after, words):
    assert change(before, after) == words


def test_errors_of_two_runs_have_their_change_and_those_of_one_or_three_have_not(two):
    summaries = [read_run(folder).summary for folder in two]
    sheet = joint_sheets(["a", "b"], summaries)[0]
    first, second = (summary["rms_position_error_deg"] for summary in summaries)
    assert sheet.columns[-1] == "change"
    # the change is that of numbers with three digits: 0.5 % of each
    assert [row[-1] for row in sheet.rows] == [change(a, b) for a, b in zip(first, second, strict=True)]
    assert len(joint_sheets(["a", "b", "c"], [*summaries, summaries[0]])[0].columns) == 4
    runs = [read_run(folder) for folder in two]
    assert b'id="comparison"' not in report_page(runs[:1])
    page = report_page(runs).decode()
    order = ['<p class="verdict">first is better in', "What differs", "What they do", "Position RMS", 'id="arm"']
    places = [page.index(words) for words in order]
    assert places == sorted(places)
    assert 'class="sortable"' not in page
    three = report_page([*runs, runs[0]]).decode()
    listed = three[three.index('<table class="sortable">') :]
    margin = runs[1].summary["key_figures"]["margin"]["value"]
    assert listed[: listed.index("</table>")].count("<tr>") == 4 and f'<data value="{margin!r}">' in listed


def run_of(state="good", **figures):
    figures = {key: {"value": value, "unit": unit} for key, (value, unit) in figures.items()}
    summary = {"key_figures": figures, "verdict": {"state": state, "words": "", "checks": []}}
    return ShownRun("run", Results(np.zeros(1), [], {}, {}), summary, Path("none"))


def answered(names, runs):
    return answer(names, runs, difference_sheet(names, runs))


def test_the_answer_says_which_run_is_better_in_what_and_by_how_much():
    first = run_of(tool_error=(6e-6, ""), margin=(0.8, ""), torque=(10.0, "N.m"))
    second = run_of(tool_error=(2e-6, ""), margin=(0.2, ""), torque=(10.001, "N.m"))
    assert answered(["a", "b"], [first, second]) == (
        "b is better in tool error (2 µm instead of 6 µm, × 0.333); "
        "a is better in modulus margin (0.8 instead of 0.2, × 4)."
    )
    assert answered(["a", "b"], [first, first]) == "The runs are equivalent: no key figure differs by 5 % or more."
    assert answered(["a", "b"], [run_of("failed", margin=(0.9, "")), second]) == "b is better: a failed."
    third = run_of(tool_error=(1.2e-6, ""), torque=(9.0, "N.m"))
    assert answered(["a", "b", "c"], [first, second, third]).startswith(
        "c is best in tool error (1.2 µm instead of 2 µm, × 0.6) and peak torque (9 N.m instead of 10 N.m, × 0.9)"
    )


@pytest.mark.heavy
def test_joints_are_drawn_one_by_one_over_each_other_or_as_differences(two, browser, quiet, tmp_path):
    show(browser, write_report([read_run(folder) for folder in two], tmp_path / "comparison.html"), 1280, 1600)
    grid = "[...document.querySelectorAll('#comparison .chart')]"
    browser.run("document.querySelector('#comparison .grid').scrollIntoView()")
    browser.settle()
    assert browser.run(f"{grid}.map(e => e.querySelector('strong').textContent)") == ["Joint 1", "Joint 2"]
    # on the first screen of a laptop, above the tables
    top = "document.querySelector('#comparison .chart').getBoundingClientRect().top + scrollY"
    assert browser.run(top) < 450 < browser.run(top.replace(".chart", ".tables"))
    first, second = (Results.read(folder / "results.csv") for folder in two)
    drawn = browser.run("""(() => {
        const curves = report.curvesOf("figures", "tracking.revolute").filter(c => c.joint === 2);
        const { time, values } = report.differences(curves)[0];
        return [[...time], [...values]];
    })()""")
    times, values = map(np.array, drawn)
    rows = np.round(times / 0.002).astype(int)
    error = [np.degrees(results["trajectory.q_d[2]"] - results["plant.q[2]"]) for results in (first, second)]
    # single precision of errors up to their largest: 2^-24 of it, each of two
    limit = 2 * 2.0**-24 * max(np.abs(curve).max() for curve in error)
    np.testing.assert_allclose(values, error[1][rows] - error[0][2 * rows], rtol=0, atol=limit)
    browser.run("document.querySelector('#comparison .bar button').click()")
    browser.settle()
    names = "document.querySelectorAll('#figures figcaption strong')"
    assert not browser.run(f"[...{names}].some(e => e.textContent.includes('dashed'))")
