"""The Content-Security-Policy of each page: its own scripts run, and no other."""

import base64
import html.parser
import re
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import show
from vdfmu.base import page as frame
from vdfmu.base.extras import extra_modules
from vdfmu.base.files import read_member
from vdfmu.engine.results.results import Signal
from vdfmu.study.report.page import StudyPart, report_page, study_page
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.scene import arm_of

INERT = ("application/json", "text/plain")
"""Types of script elements that a browser does not run."""


class Elements(html.parser.HTMLParser):
    """Scripts that a browser would run, and attributes that would run one."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.scripts, self.handlers, self._inside = [], [], False
        self.feed(page.decode())

    def handle_starttag(self, tag, attrs):  # noqa: D102
        self.handlers += [name for name, value in attrs if name.startswith("on") or "javascript:" in (value or "")]
        self._inside = tag == "script" and dict(attrs).get("type") not in INERT

    def handle_endtag(self, tag):  # noqa: D102
        self._inside = False

    def handle_data(self, data):  # noqa: D102
        if self._inside:
            self.scripts.append(data)


def sources(page: bytes) -> list[str]:
    """Return what the policy of a page, which stands before all else that it forbids, lets run."""
    (policy,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="(.*?)">', page.decode())
    assert page.index(policy.encode()) < min(page.index(b"<style"), page.index(b"<title"))
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    return rules.get("script-src", "").split()


def run() -> ShownRun:
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {})
    signals = [Signal(f"plant.q[{i}]", "real", "rad", i - 1) for i in (1, 2)]
    results = vdfmu.Results(np.linspace(0.0, 1.0, 11), signals, {"real": np.zeros((11, 2))}, {"arm": arm})
    return ShownRun("run", results, results.summary, Path(""))


@pytest.fixture
def pages(tmp_path):
    robot, shown, study = vdfmu.load_robot("planar_2dof"), run(), StudyPart("study", "about", "", {}, "lead")
    return {
        "run": report_page([shown]), "sweep": report_page([shown], study=study),
        "study": study_page(study), 
        "package": frame.page("package", "", "", 76),
        **{each.__name__: each.robot_page(robot, None, None)[0] for each in extra_modules("robot_page")},
        **{
            each.__name__: each.write_gallery(tmp_path, tmp_path / "index.html").read_bytes()
            for each in extra_modules("gallery")
        },
        **{each.__name__: report_page([shown, shown]) for each in extra_modules("comparison")},
    }  # fmt: skip


def test_each_page_names_its_scripts_by_their_hashes_and_no_other(pages):
    for name, page in pages.items():
        allowed, elements = sources(page), Elements(page)
        digests = [f"'sha256-{base64.b64encode(sha256(code.encode()).digest()).decode()}'" for code in elements.scripts]
        assert len(digests) == (name != "package") and {*digests} <= {*allowed}, name
        assert {source.partition("-")[0] for source in allowed} <= {"'sha256", "'wasm"}, name
        assert not elements.handlers, name


@pytest.mark.heavy
def test_a_script_that_a_page_does_not_name_does_not_run(browser, tmp_path):
    """Written into the page as a fault in escaping would let it: as an element, and as a handler."""
    vdfmu.run("planar_tracking", stop=0.1, out=tmp_path, reference=False, simulate=True)
    injected = b"<script>document.title = 'ran'</script><img src='data:,' onerror=\"document.title = 'ran'\"></main>"
    for name, page in (
        ("report", (tmp_path / "report.html").read_bytes()),
        ("package", read_member(tmp_path / "system.ssp", "documentation/index.html")),
    ):
        file = tmp_path / f"{name}.injected.html"
        file.write_bytes(page)
        browser.problems.clear()
        show(browser, file)
        assert browser.problems == []
        title = browser.run("document.title")
        file.write_bytes(page.replace(b"</main>", injected, 1))
        show(browser, file)
        assert browser.run("document.title") == title
        # refused as an element and as a handler; the picture that is none is no message
        assert [problem.count("Content Security Policy") for problem in browser.problems] == [1, 1], browser.problems
        if name == "report":  # and all that is the page's own runs, the worker with its WebAssembly too
            rows = (
                "new report.SimulationWorker(report.binaries).run(report.runs[0].simulation).then(r => r.time.length)"
            )
            assert browser.run(rows) == 101
    browser.problems.clear()
