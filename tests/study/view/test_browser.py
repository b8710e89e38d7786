"""Views in a browser: the arm is seen, sliders move it, a run moves it, nothing foreign is asked for."""

import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from urllib.parse import urlsplit

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import Browser, pixels

pytestmark = pytest.mark.heavy


@pytest.fixture(autouse=True)
def quiet(browser):
    """Hold of every test that the console had no error and the page asked for nothing but its server."""
    browser.problems.clear()
    browser.requests.clear()
    yield
    assert browser.problems == []
    address = f"http://{urlsplit(browser.address).netloc}/"
    assert any(address in url for url in browser.requests)
    assert all(url.startswith(("data:", address, f"blob:{address}")) for url in browser.requests)


def show(browser: Browser, address: str, *size: int, **more: str) -> None:
    browser.address = address
    try:
        browser.open(address, *size, **more)
    except RuntimeError:  # the page of a run takes the place of the one before it while that is opened
        wait(browser, "globalThis.report")


def wait(browser: Browser, condition: str) -> None:
    for _ in range(300):
        with suppress(RuntimeError):  # the page loads another one at times
            if browser.run(f"Boolean({condition})"):
                return
        time.sleep(0.1)
    raise AssertionError(f"{condition} did not come true")


@pytest.fixture(scope="module")
def view():
    shown, ended = vdfmu.RobotView(vdfmu.load_robot("planar_2dof")), threading.Event()
    thread = threading.Thread(target=shown.run, args=(ended.is_set,))
    thread.start()
    yield shown
    ended.set()
    thread.join()
    shown.close()


def test_a_slider_moves_the_arm_and_modes_are_found_anew(view, browser):
    show(browser, view.address)
    wait(browser, "document.querySelectorAll('.chip.mode').length === 2")
    before, chips = pixels(browser, ".canvas"), browser.run("document.querySelector('.modes').innerText")
    # links, floor and plate, of some per cent of the picture
    assert (before < 235).mean() > 0.01
    browser.run("document.querySelectorAll('#joints [type=range]')[1].focus()")
    browser.key("Home", 36)
    wait(browser, f"document.querySelector('.modes').innerText !== {chips!r}")
    assert view.pose[1] == pytest.approx(-np.pi)  # the end of a joint without end stops
    assert (np.abs(pixels(browser, ".canvas") - before) > 30).mean() > 0.005
    assert browser.run("document.querySelectorAll('#joints [type=range]')[1].ariaValueText") == "−180.0 deg"
    view.show(np.array([0.0, 0.5]))
    wait(browser, "report.state.q[1] === 0.5")
    assert browser.run("document.querySelectorAll('#joints output')[1].textContent") == "28.6 deg"


def test_parts_are_shown_and_hidden(view, browser):
    show(browser, view.address, 1280, 900, scheme="dark")
    seen = [pixels(browser, ".canvas")]
    for name in ("frames", "centres of mass", "ellipsoids of inertia", "gravity"):
        browser.run(f"[...document.querySelectorAll('.chip')].find((c) => c.textContent === {name!r}).click()")
        browser.settle()
        seen.append(pixels(browser, ".canvas"))
    browser.run("document.querySelector('#arm select').value = 'hidden'")
    browser.run("document.querySelector('#arm select').dispatchEvent(new Event('change'))")
    browser.settle()
    seen.append(pixels(browser, ".canvas"))
    # a ball of 1.4 % of the reach is the least: some hundred pixels of 4e5
    assert all((np.abs(b - a) > 20).mean() > 1e-4 for a, b in zip(seen, seen[1:], strict=False))


def test_a_mode_moves_the_arm_by_its_shape(view, browser):
    show(browser, view.address)
    wait(browser, "document.querySelector('.chip.mode')")
    browser.run("document.querySelector('.chip.mode').click()")
    most = browser.run(
        "new Promise((d) => { let most = 0; const began = performance.now(); const look = (now) => { "
        "const { state, scene } = report, shape = state.modes[0].real; "
        "most = Math.max(most, ...scene.q.map((q, i) => Math.abs(q - state.q[i]))); "
        "now < began + 4000 ? requestAnimationFrame(look) : d(most); }; requestAnimationFrame(look); })"
    )
    assert (
        0.05 < most <= 0.2 * 1.001
    )  # the amplitude, at the pictures that there were; damping turns the shape by itself
    browser.run("document.querySelector('.chip.mode').click()")
    browser.settle()
    assert browser.run("report.scene.q.every((q, i) => q === report.state.q[i])")


def test_where_motion_is_not_wanted_a_mode_is_still(view, browser):
    show(browser, view.address, 1280, 900, motion="reduce")
    wait(browser, "document.querySelector('.chip.mode')")
    browser.run("document.querySelector('.chip.mode').click()")
    browser.settle()
    still = browser.run("report.scene.q")
    assert still != browser.run("report.state.q")
    browser.settle()
    assert browser.run("report.scene.q") == still
    browser.run("document.querySelector('.chip.mode').click()")
    browser.settle()


def test_on_a_phone_the_arm_is_above_the_panel(view, browser):
    show(browser, view.address, 390, 844)
    assert browser.run("document.documentElement.scrollWidth") <= 390
    assert (pixels(browser, ".canvas") < 200).mean() > 0.005
    assert browser.run("document.querySelector('.canvas').getBoundingClientRect().bottom") < 500


@pytest.mark.skipif(sys.platform == "win32", reason="the terminal of this test is a Unix one")
def test_a_run_is_seen_while_it_goes_on_and_after_it(browser, tmp_path):
    import pty

    _, terminal = pty.openpty()
    log = tmp_path / "log"
    words = "run planar_tracking --live --pace 0.1 --stop 1 --no-reference --no-simulate"
    with open(log, "w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "vdfmu.cli", *words.split()], stdin=terminal, stdout=file,
            stderr=subprocess.STDOUT, cwd=tmp_path,
        )  # fmt: skip
    try:
        while not (match := re.search(r"http://\S+/", log.read_text())):
            assert process.poll() is None, log.read_text()
            time.sleep(0.1)
        show(browser, match[0])
        wait(browser, "document.querySelector('.state')?.textContent.startsWith('Running')")
        first = browser.run("report.view.time")
        time.sleep(2.0)  # a fifth of the run
        assert browser.run("report.view.time") > first
        assert browser.run("report.charts[0].plot.data[0].length") > 2
        wait(browser, "document.querySelector('.verdict')?.textContent.startsWith('Good: stable')")
        wait(browser, "globalThis.report && document.querySelectorAll('.tile').length >= 4")
        assert browser.run("report.view.full()") == [0, 1]
        before = pixels(browser, ".canvas")
        browser.key("End", 35)
        browser.settle()
        assert (np.abs(pixels(browser, ".canvas") - before) > 30).mean() > 0.002
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0, log.read_text()
        wait(browser, "document.body.innerText.includes('has ended, or cannot be reached')")
    finally:
        process.kill()
        process.wait()
    assert re.search(r"^The view stays until .*: http://127\.0\.0\.1:\d+/[\w-]+/$", log.read_text(), re.MULTILINE)
    browser.problems[:] = [problem for problem in browser.problems if "ERR_CONNECTION_REFUSED" not in problem]
