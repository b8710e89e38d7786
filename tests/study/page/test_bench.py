"""The first screen and the bench: what is in sight together, where tiles lead, what an address keeps."""

import json
import shlex
import time

import pytest

import vdfmu
from tests.study.page.browser import centre, show
from vdfmu.base.measure import quantity

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
DESKTOPS = [(1280, 900), (1440, 900)]
PHONE = (390, 844)
SEEN = """((...selectors) => selectors.map(one => {
    const { top, bottom } = document.querySelector(one).getBoundingClientRect();
    return [Math.round(top), Math.round(bottom)];
}))"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    vdfmu.run("tracking", stop=1.0, out=folder, parameters={"trajectory.T": 1.0}, simulate=True)
    return folder


def clicked(browser, words):
    browser.run(f"[...document.querySelectorAll('button')].find(e => e.textContent.startsWith({words!r})).click()")
    browser.settle()


def until(browser, condition):
    """Wait for a condition, for 20 s at most: a browser without a graphics card draws slowly."""
    browser.run(
        f"(async () => {{ for (let k = 0; k < 1000 && !({condition}); k += 1) "
        "await new Promise((done) => setTimeout(done, 20)); })()"
    )


@pytest.mark.parametrize("size", DESKTOPS)
def test_arm_slider_and_figure_are_in_sight_together(run, browser, size):
    show(browser, run / "report.html", *size)
    for tile in (None, "Worst joint", "Peak torque"):
        if tile:
            clicked(browser, tile)
            time.sleep(1.0)  # it scrolls smoothly
        figure = ".found-now" if tile else "#figures .chart"
        canvas, slider, plot = browser.run(f"{SEEN}('.canvas', '#simulate input', {figure + ' .u-over'!r})")
        for top, bottom in (canvas, slider):
            assert top >= 0 and bottom <= size[1]
        # of the first figure on the first screen three quarters at least, of one that was asked for all
        assert plot[0] > slider[1] and (plot[1] if tile else plot[0] + 0.75 * (plot[1] - plot[0])) <= size[1]


def test_on_a_phone_the_arm_stays_above_the_sliders_and_tiles_lead_to_their_figure(run, browser):
    show(browser, run / "report.html", *PHONE)
    tile, canvas = browser.run(f"{SEEN}('.tile', '.canvas')")
    assert tile[1] < canvas[0]  # the numbers come first
    for selector in ("#simulate input", "#figures .chart:nth-child(3) .plot"):
        centre(browser, selector)
        (top, bottom), under = browser.run(f"{SEEN}('.canvas', {selector!r})")
        assert (top, bottom) == (0, 200) and under[0] >= bottom
    show(browser, run / "report.html")
    figures = json.loads((run / "summary.json").read_text())["key_figures"]
    for words, key, figure in (
        ("Tool error", "tool_error", "tool"),
        ("Worst joint", "joint_error", "tracking.revolute"),
    ):
        clicked(browser, words)
        assert browser.run("report.view.time") == figures[key]["at_s"]
        assert browser.run("document.querySelector('.found-now').dataset.figure") == figure
    browser.run("document.querySelector('.marks button').click()")
    assert browser.run("report.view.time") == figures["tool_error"]["at_s"]


def test_the_page_and_python_write_numbers_alike(run, browser):
    show(browser, run / "report.html")
    numbers = [0.0, 0.1, 0.763, 2.89e-6, -1234.5, 12345.0, 999.6e-6, 4.56e-13, 0.01, 1e7, 35.55]
    cases = [
        (value, unit, peak)
        for value in numbers
        for unit in ("m", "mm", "deg", "N.m", "Hz", "", "W/K")
        for peak in (0, 1e4)
    ]
    texts = browser.run(f"{json.dumps(cases)}.map(one => report.quantity(...one))")
    assert texts == [quantity(*case) for case in cases]


def test_the_wheel_scrolls_the_page_until_the_scene_is_asked(run, browser):
    show(browser, run / "report.html")
    x, y = (
        (box := browser.run("document.querySelector('.canvas').getBoundingClientRect().toJSON()"))["x"] + 99,
        box["y"] + 99,
    )
    state = "[scrollY, report.player.scene.camera.position.distanceTo(report.player.scene.controls.target)]"

    def wheel(**more):
        browser.run("scrollTo(0, 0)")
        browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=200, **more)
        time.sleep(0.5)  # both glide
        return browser.run(state)

    _, before = browser.run(state)
    wheel()  # draws what comes into sight, which may move the page
    assert wheel() == [200, pytest.approx(before)]
    scrolled, nearer = wheel(modifiers=2)
    assert scrolled == 0 and nearer > 1.01 * before
    for kind in ("mousePressed", "mouseReleased"):
        browser.mouse(kind, x, y, button="left", clickCount=1)
    assert wheel()[0] == 0


def test_an_address_keeps_time_and_figure(run, browser):
    show(browser, run / "report.html")
    browser.run("report.view.change('time', 0.25)")
    clicked(browser, "Peak torque")
    browser.run("report.view.change('time', 0.5)")
    until(browser, "location.hash.includes('t=0.5')")  # it is written after a pause
    address = browser.run("location.href")
    assert address.endswith("#figure=torque&t=0.5") or address.endswith("#t=0.5&figure=torque")
    browser.open("about:blank")
    browser.asked = [(run / "report.html").as_uri()] * 2
    browser.open(address)
    assert browser.run("report.view.time") == 0.5
    assert browser.run("document.querySelector('.found-now').dataset.figure") == "torque.revolute"


def test_the_command_has_what_the_sliders_changed(run, browser):
    show(browser, run / "report.html")
    browser.run("navigator.clipboard.writeText = async (text) => { globalThis.kept = text; }")
    clicked(browser, "Copy as command")
    assert browser.run("kept") == "vdfmu run tracking --stop 1 --set trajectory.T=1.0"
    browser.run("report.simulation.sliders[0].places[2] = 50")
    clicked(browser, "Copy as command")
    words = shlex.split(browser.run("kept"))
    # half of the way to the largest factor, 10: its root with three digits, of K_p[2] = 2000
    assert words[-2:] == ["--set", "controller.K_p[2]=6320"]
    # a point of a study is under the sliders, which start at 1 again
    browser.run("report.simulation.open([{ unit: 'controller', name: 'K_p', value: 1234 }])")
    clicked(browser, "Copy as command")
    assert shlex.split(browser.run("kept"))[-2:] == ["--set", "controller.K_p=1234"]
