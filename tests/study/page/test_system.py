"""The diagram of the system in a browser: labels apart, values at the time shown, wires as buttons."""

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import show
from tests.system.package.pictures import NAMES, picture
from vdfmu.engine.results.results import Results

pytestmark = [pytest.mark.heavy]


@pytest.mark.parametrize("name", NAMES)
def test_texts_do_not_overlap(name, tmp_path, browser):
    """With a value of ten characters on each wire; texts of the same place in a browser."""
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><meta charset=utf-8><body>{picture(name)}", encoding="utf-8")
    browser.open(page)
    overlaps = browser.run("""(() => {
        const svg = document.querySelector("svg"), bad = [];
        svg.style = `width: ${svg.viewBox.baseVal.width}px`;
        for (const value of svg.querySelectorAll(".value")) value.textContent = "−0.123 rad/s2";
        const boxOf = (e) => { const { x, y, width, height } = e.getBBox(); return [x, y, x + width, y + height]; };
        const boxes = [...svg.querySelectorAll("text")].filter(t => t.textContent).map(t => [t.textContent, boxOf(t)]);
        const cards = [...svg.querySelectorAll("rect")].map(boxOf);
        const hit = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
        const inside = (a, b) => a[0] > b[0] && a[1] > b[1] && a[2] < b[2] && a[3] < b[3];
        boxes.forEach(([words, a], k) => {
            for (const [other, b] of boxes.slice(k + 1)) if (hit(a, b)) bad.push([words, other]);
            for (const card of cards) if (hit(a, card) && !inside(a, card)) bad.push([words, "card"]);
        });
        return bad;
    })()""")
    assert overlaps == []


def test_wires_show_the_values_at_the_time_shown_and_choose_their_signal(tmp_path, browser, quiet):
    vdfmu.run("tracking", stop=0.2, out=tmp_path)
    page = tmp_path / "report.html"
    show(browser, page)
    browser.run("document.getElementById('system').scrollIntoView()")
    browser.run("report.view.change('time', 0.1)")
    browser.settle()
    results = Results.read(tmp_path / "results.csv")
    tau = results["controller.tau"][100]
    wire = "document.querySelector('[data-signal=\"controller.tau\"]')"
    assert browser.run(f"{wire}.querySelector('.value').textContent") == f"{tau[np.argmax(np.abs(tau))]:.3g} N.m"
    assert browser.run(f"{wire}.getAttribute('aria-pressed')") == "true"  # chosen at first
    browser.run("document.querySelector('[data-signal=\"plant.q\"]').focus()")
    browser.key("Enter", 13)
    assert browser.run("document.querySelector('#system select').value") == "plant.q"
    assert browser.run("document.querySelectorAll('.wire.on').length") == 1
    # feedforward runs before the trajectory in a step: it gets what that gave in the step before
    held = browser.run("document.querySelectorAll('[data-signal=\"trajectory.q_d\"] .held').length")
    assert held == 2
