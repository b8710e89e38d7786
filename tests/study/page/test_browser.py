"""The page of a run in a browser: what it shows, what it does, what it asks for."""

import csv
import json
from xml.etree import ElementTree

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import centre, show
from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.base import page
from vdfmu.base.measure import fitted
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.results import Results
from vdfmu.study.report.page import write_report
from vdfmu.study.report.shown_run import read_run

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
PHONE = (390, 844)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracking")
    vdfmu.run("tracking", stop=1.0, out=folder, parameters={"trajectory.T": 1.0})
    return folder


def test_poses_are_those_of_the_equations(run, browser):
    show(browser, run / "report.html")
    poses = np.array(browser.run("""(() => {
        const run = report.runs[0], chain = new report.Chain(run.arm), motion = new report.Motion(run);
        return Array.from(motion.time, (_, k) => {
            const p = (chain.set(motion.row("q", k)), chain.tool.getWorldPosition(chain.tool.position.clone()));
            return [...p, ...chain.tool.matrixWorld.elements];
        });
    })()"""))  # fmt: skip
    results = Results.read(run / "results.csv")
    # positions of joints in single precision, 2^-24 of at most 2 rad each, at arms of 1.4 m: 6 * 1.2e-7 * 1.4 m
    np.testing.assert_allclose(poses[:, :3], results["plant.p_O"], atol=1e-6)
    robot = vdfmu.load_robot("manipulator_6dof")
    for row in (0, 500, 1000):
        p, R = forward_kinematics(robot, results["plant.q"][row])
        pose = poses[row, 3:].reshape(4, 4).T  # column by column in three.js
        np.testing.assert_allclose(pose[:3, 3], p, atol=1e-6)
        np.testing.assert_allclose(pose[:3, :3], R, atol=1e-6)


def test_the_error_of_the_end_effector_is_that_of_desired_and_actual_positions(run, browser):
    show(browser, run / "report.html")
    errors = np.array(browser.run("Array.from(report.toolErrors(report.runs[0]).values)"))
    results = Results.read(run / "results.csv")
    robot = vdfmu.load_robot("manipulator_6dof")
    for row in (100, 500, 900):
        ends = [forward_kinematics(robot, results[f"{name}"][row])[0] for name in ("trajectory.q_d", "plant.q")]
        # the errors of joints keep their digits; positions in single precision turn the difference by 1e-6 of itself
        assert errors[row] == pytest.approx(1e3 * np.linalg.norm(ends[0] - ends[1]), rel=1e-5)


def test_dragging_zooms_all_figures_and_a_double_click_ends_it(run, browser):
    show(browser, run / "report.html", 1280, 1400)
    x, y = centre(browser, "#figures .chart:nth-child(1) .u-over")
    for kind, dx, held in (
        ("mouseMoved", 0, 0),
        ("mousePressed", 0, 1),
        ("mouseMoved", 100, 1),
        ("mouseReleased", 100, 0),
    ):
        browser.mouse(kind, x + dx, y, button="left", buttons=held, clickCount=1)
    limits = "report.charts.slice(0, 2).map(c => [c.plot.scales.x.min, c.plot.scales.x.max])"
    first, second = browser.run(limits)
    assert first == second and 0.4 < first[0] < 0.6 and 0.05 < first[1] - first[0] < 0.4
    for kind in ("mousePressed", "mouseReleased") * 2:
        browser.mouse(kind, x, y, button="left", clickCount=2)
    assert browser.run(limits) == [[0, 1], [0, 1]]


def test_names_stand_at_the_ends_of_curves_without_overlaps(run, browser):
    show(browser, run / "report.html", 1280, 1400)
    for chart, n in ((0, 6), (2, 6)):
        ends = browser.run(f"report.charts[{chart}].ends()")
        assert sorted(label["text"] for label in ends) == [f"joint {i}" for i in range(1, n + 1)]
        places = [label["place"] for label in ends]
        assert min(np.diff(places)) >= 11.99  # 12 px apart, and sums of such numbers
        assert all(np.diff([label["end"] for label in ends]) >= 0.0)  # no two lines to names cross
    strokes = [browser.run(f"report.charts[{k}].strokeOf(report.charts[{k}].unpacked[0])") for k in (0, 1)]
    assert strokes == [page.LIGHT[0], browser.run("getComputedStyle(document.body).getPropertyValue('--ink').trim()")]


def test_pointing_to_a_joint_fades_the_others_and_alt_shows_it_alone(run, browser):
    show(browser, run / "report.html", 1280, 1400)
    x, y = centre(browser, "#figures .bar .chip:nth-child(4)")  # after a word, of joint 3
    browser.mouse("mouseMoved", x, y)
    alphas = "report.charts[0].plot.series.slice(1).map(s => s.alpha)"
    assert browser.run(alphas) == [0.15, 0.15, 1, 0.15, 0.15, 0.15]
    for _ in range(2):
        for kind in ("mousePressed", "mouseReleased"):
            browser.mouse(kind, x, y, button="left", clickCount=1, modifiers=1)
        shown = browser.run("report.charts[0].plot.series.slice(1).map(s => s.show)")
        assert shown == [k == 2 for k in range(6)] or _ == 1
    assert shown == [True] * 6
    browser.mouse("mouseMoved", x, y + 60)
    assert browser.run("report.view.focus") is None
    # the middle of a figure without its curve nearby points to none, next to a curve to that one
    curve = browser.run("""(() => {
        const { plot } = report.charts[0], box = plot.over.getBoundingClientRect(), row = plot.data[0].length >> 1;
        return [box.left + plot.valToPos(plot.data[0][row], "x"), box.top + plot.valToPos(plot.data[2][row], "y")];
    })()""")
    browser.mouse("mouseMoved", *curve)
    assert browser.run("report.view.focus") in range(1, 7)


def test_a_figure_is_saved_as_drawing_picture_and_table(run, browser):
    show(browser, run / "report.html", 1280, 1400)
    results = Results.read(run / "results.csv")
    browser.run("report.view.change('range', [0.2, 0.4])")
    browser.settle()
    heads, *rows = csv.reader(browser.run("report.FILES.CSV(report.charts[0]).text()").splitlines())
    assert heads == ["time [s]", *(f"joint {i} [deg]" for i in range(1, 7))]
    table = np.array(rows, dtype=float)
    places = np.rint(1e3 * table[:, 0]).astype(int)
    assert places[0] == 200 and places[-1] == 400
    error = np.degrees(results["trajectory.q_d"] - results["plant.q"])[places]
    np.testing.assert_allclose(table[:, 1:], error, rtol=2**-24, atol=1e-30)  # single precision
    drawing = ElementTree.fromstring(browser.run("report.FILES.SVG(report.charts[0]).text()"))
    texts = {text.text for text in drawing.iter("{http://www.w3.org/2000/svg}text")}
    unit = browser.run("report.charts[0].unitText.textContent")
    assert {"joint 1", "joint 6", f"Position tracking errors: q_d − q [{unit}]"} <= texts and unit.endswith("deg")


def test_units_are_those_of_the_pictures_and_a_click_on_a_wire_shows_its_signal(run, browser):
    show(browser, run / "report.html")
    cases = [(unit, 2.5 * 10.0**k) for unit in ("deg", "mm", "N.m", "rad/s", "m²", "Hz", "") for k in range(-14, 8)]
    fit = "report.charts[0].fit.call({ unit }, value)"
    made = browser.run(f"{json.dumps(cases)}.map(([unit, value]) => {fit})")
    for (unit, value), (name, exponent) in zip(cases, made, strict=True):
        wanted, power = fitted(unit, value)
        assert exponent == power and (name == wanted or (name.startswith("10") and not wanted)), (unit, value)
    show(browser, run / "report.html")
    browser.run("document.querySelector('.system .hit').dispatchEvent(new MouseEvent('click', { bubbles: true }))")
    browser.settle()
    signal = browser.run("document.querySelector('.system .hit').parentElement.dataset.signal")
    assert browser.run("document.querySelector('#system figcaption strong').textContent") == signal == "trajectory.q_d"
    assert browser.run("document.querySelectorAll('.system .wire.on').length") == 1


def test_keys_play_step_and_read_the_values_of_a_figure(run, browser):
    show(browser, run / "report.html")
    browser.key("ArrowRight", 39)
    assert browser.run("report.view.time") == pytest.approx(0.005)  # 200 steps of the run
    browser.key("End", 35)
    assert browser.run("report.view.time") == 1.0
    browser.key("Home", 36)
    browser.run("report.player.speed = 0.1")  # so that it does not end by itself
    browser.key(" ", 32)
    assert browser.run("report.player.playing")
    browser.run("new Promise(done => setTimeout(done, 300))")
    browser.key(" ", 32)
    assert not browser.run("report.player.playing")
    assert 0.02 < browser.run("report.view.time") < 1.0
    show(browser, run / "report.html", 1280, 1400)
    centre(browser, "#figures .chart:nth-child(1) .u-over")
    browser.run("document.querySelector('#figures .plot').focus()")
    for _ in range(2):
        browser.key("ArrowRight", 39)
    words = browser.run("document.querySelector('#figures .tip').innerText")
    assert words.startswith("0.01 s") and "joint 6" in words


def test_the_arm_of_another_run_stands_beside_that_of_a_run(run, browser, tmp_path):
    pytest.importorskip("vdfmu.extras.compare")
    first = read_run(run)
    show(browser, write_report([first, first._replace(name="other")], tmp_path / "comparison.html"))
    arms = "report.player.scene.puppets.length"
    words = "[...document.querySelectorAll('.canvas .name')].map(e => e.textContent)"
    assert browser.run(arms) == 2
    assert browser.run(words) == [run.name, "other"]
    assert browser.run("document.querySelector('.readout caption').textContent").endswith("; on the right: other")
    assert browser.run("document.querySelectorAll('.readout output.second').length") == len(
        first.summary["arm"]["types"]
    )
    find = "const s = document.querySelectorAll('#arm .bar .choice select')[k]; s.value = value;"
    choose = "((k, value) => { " + find + " s.dispatchEvent(new Event('change')); })"
    browser.run(f"{choose}(1, -1)")
    assert (browser.run(arms), browser.run(words)) == (1, [])
    browser.run(f"{choose}(0, 1)")
    browser.run(f"{choose}(1, 0)")
    assert (browser.run(arms), browser.run(words)) == (2, ["other", run.name])


def test_a_page_of_a_package_has_figures_of_its_signals_and_no_arm(run, browser, tmp_path):
    run_system(run / "system.ssp", stop=0.1, out=tmp_path)
    show(browser, write_report([read_run(tmp_path)], tmp_path / "report.html"))
    assert browser.run("report.player") is None
    assert browser.run("document.getElementById('arm').hidden")
    assert browser.run("document.getElementById('arm').offsetHeight") == 0
    assert browser.run("report.charts.length") > 0  # one for each unit of measurement
