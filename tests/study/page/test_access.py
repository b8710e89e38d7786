"""That everybody can use the pages: rules of accessibility, sizes of texts and controls, the keyboard alone, rest."""

from pathlib import Path

import pytest

from tests.study.page.browser import FIND_OUT, PHONE, WIDE, draw_all, show
from vdfmu.base.extras import extra_modules

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
AXE = Path(__file__).parents[3] / "requirements" / "web" / "node_modules" / "axe-core" / "axe.min.js"
LAYOUT = (Path(__file__).parent / "layout.js").read_text(encoding="utf-8")
KINDS = ["run", "arm", "study", *(["comparison", "list"] if extra_modules("gallery") else [])]


@pytest.mark.skipif(not AXE.exists(), reason="needs axe-core: make pages")
@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (PHONE, "dark")])
@pytest.mark.parametrize("kind", KINDS)
def test_axe_finds_no_violation(pages, browser, kind, size, scheme):
    show(browser, pages[kind], *size, scheme=scheme)
    draw_all(browser)
    browser.run(f"{AXE.read_text(encoding='utf-8')}; null")
    options = "{ resultTypes: ['violations'], rules: { 'target-size': { enabled: true } } }"
    listed = "violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html.slice(0, 200))])"
    assert browser.run(f"axe.run(document, {options}).then(({{ violations }}) => {listed})") == []


@pytest.mark.parametrize("size", [WIDE, PHONE])
@pytest.mark.parametrize("kind", KINDS)
def test_no_text_control_or_bar_is_small_or_cut(pages, browser, kind, size):
    show(browser, pages[kind], *size)
    draw_all(browser)
    if kind == "run":
        browser.run(FIND_OUT)
    assert browser.run(LAYOUT) == []


@pytest.mark.parametrize("kind", KINDS)
def test_the_tab_key_reaches_everything_and_shows_where_it_is(pages, browser, kind):
    show(browser, pages[kind], *WIDE)
    draw_all(browser)
    can = "a[href], button, select, input, summary, [tabindex='0']"
    browser.run(
        f"globalThis.stops = [...document.querySelectorAll({can!r})].filter((e) => e.checkVisibility() && !e.disabled)"
    )
    count = browser.run("stops.length")
    reached = []
    for _ in range(count + 3):
        for event in ("keyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", type=event, key="Tab", windowsVirtualKeyCode=9)
        reached.append(browser.run("""(() => {
            const e = document.activeElement, style = getComputedStyle(e.querySelector(".hit") ?? e);
            return [stops.indexOf(e), style.outlineStyle !== "none" || style.stroke !== "none"];
        })()"""))  # fmt: skip
    assert {place for place, _ in reached} >= {*range(count)}
    assert all(shown for place, shown in reached if place >= 0)
    if kind in ("run", "study"):
        assert browser.run(f"stops[{reached[0][0]}].textContent") == "Skip to the figures"


def test_keys_alone_choose_a_point_and_simulate(pages, browser):
    show(browser, pages["study"], *WIDE)
    browser.run("document.querySelector('.panel button').focus()")
    browser.key("Enter", 13)
    assert browser.run("report.lab.chosen") is not None
    show(browser, pages["run"], *WIDE)
    browser.run("document.querySelector('.slider input').focus()")
    browser.key("ArrowRight", 39)
    assert browser.run("document.querySelector('.slider input').value") == "1"
    browser.run("document.querySelector('.tile').focus()")
    browser.key("Enter", 13)
    assert browser.run("report.view.time") == float(browser.run("document.querySelector('.tile').dataset.time"))


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_moves_by_itself_where_motion_is_not_wanted(pages, browser, kind):
    moving = """[...document.querySelectorAll("*")].map((e) => getComputedStyle(e)).filter((style) =>
        style.animationName !== "none" || style.scrollBehavior !== "auto" ||
        style.transitionDuration.split(", ").some((time) => time !== "0s")).length"""
    show(browser, pages[kind], *WIDE)
    assert browser.run(moving) > 0 or kind == "list"
    show(browser, pages[kind], *WIDE, motion="reduce")
    assert browser.run(moving) == 0
    assert browser.run("document.getAnimations().filter((one) => one.effect.getTiming().duration > 0).length") == 0
