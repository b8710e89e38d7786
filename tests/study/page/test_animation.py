"""The arm of a run, moving: what a notebook gets, and what is written."""

import base64
import gzip
import json
import re

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import Browser
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Signal
from vdfmu.study.report.page import animate
from vdfmu.study.run.scene import arm_of

TIME = np.linspace(0.0, 2.0, 201)


def results(*names, **summary):
    """Both joints of the arm turn by 1 rad and by -0.5 rad."""
    signals = [Signal(f"{name}[{i}]", "real", "rad", i - 1) for name in names for i in (1, 2)]
    return vdfmu.Results(TIME, signals, {"real": np.outer(TIME, [0.5, -0.25])}, summary)


@pytest.fixture
def arm():
    facts = {"scenario": "swing", "robot": "planar_2dof", "arm": arm_of(vdfmu.load_robot("planar_2dof"), {})}
    return animate(results("plant.q", **facts))


def test_a_notebook_gets_the_page_with_the_arm_alone(arm, tmp_path):
    page = arm.save(tmp_path / "arm.html").read_text(encoding="utf-8")
    shown = arm._repr_html_()
    assert "\n" not in shown  # a page of the documentation takes it as it is
    assert gzip.decompress(base64.b64decode(re.search(r"atob\('(.+?)'\)", shown)[1])).decode() == page
    assert "swing, planar_2dof" in repr(arm)
    data = json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', page)[1])
    (run,) = data["runs"]
    assert (run["figures"], run["signals"]) == ([], [])
    assert run["arm"]["types"] == ["revolute", "revolute"]
    assert run["frames"]["q"][1] == 2 * len(TIME)


def test_results_without_an_arm_and_wrong_options_are_told(arm, tmp_path):
    for call, words in (
        (
            lambda: animate(results("plant.q")),
            r"animate: run must be results of an arm, or their folder, got results without",
        ),
        (lambda: animate(results("plant.x", arm={})), r"positions of the joints, plant\.q\. Record them"),
        (lambda: animate(tmp_path), "expected the folder of a run"),
        (lambda: arm.save(tmp_path / "arm.gif"), r"the name must end with \.html, got .*arm\.gif"),
    ):
        with pytest.raises(UsageError, match=words):
            call()


@pytest.mark.heavy
@pytest.mark.parametrize("width", [900, 390])
def test_the_output_of_a_notebook_plays_without_a_network(arm, tmp_path, width):
    page = tmp_path / "notebook.html"
    page.write_text(f'<meta name="viewport" content="width=device-width"><p>before</p>{arm._repr_html_()}')
    inside = "document.querySelector('iframe').contentWindow"
    with Browser(tmp_path / "profile") as browser:
        browser.open(page, width)
        browser.run(
            f"new Promise(d => {{ const at = setInterval(() => {inside}.report && (clearInterval(at), d()), 50) }})"
        )
        seen = f"filter((one) => {inside}.getComputedStyle(one).display !== 'none').map((one) => one.id || one.tagName)"
        children = f"[...{inside}.document.querySelector('%s').children]"
        assert browser.run(f"{children % 'main'}.{seen}") == ["DIV", "NOSCRIPT"]
        assert browser.run(f"{children % '.bench'}.{seen}") == ["arm"]
        assert browser.run(f"{inside}.document.documentElement.scrollWidth <= {inside}.innerWidth")
        # the controls, which are last, are seen without scrolling
        assert browser.run(f"{inside}.document.documentElement.scrollHeight <= {inside}.innerHeight")
        before = browser.run(f"{inside}.report.view.time")
        browser.run(f"{inside}.document.querySelector('.play').click()")
        browser.run("new Promise(d => setTimeout(d, 500))")
        assert browser.run(f"{inside}.report.view.time") > before
        assert browser.problems == []
        assert {url for url in browser.requests if not url.startswith(("about:", "blob:"))} == {page.as_uri()}
