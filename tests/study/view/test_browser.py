"""Views in a browser: the arm is seen, sliders move it, a run moves it, nothing foreign is asked for."""

import base64
import io
import re
import signal
import subprocess
import sys
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

import vdfmu
from tests.study.page.browser import Browser

pytestmark = pytest.mark.heavy
KNOWN = "THREE.Clock: This module has been deprecated"
"""What the page of viser 1.1 says of its own libraries."""


@pytest.fixture(autouse=True)
def quiet(browser):
    """Hold of every test that the console had no error and the page asked for nothing but its server."""
    browser.problems.clear()
    browser.requests.clear()
    yield
    assert [problem for problem in browser.problems if KNOWN not in problem] == []
    own = f"://{urlsplit(browser.address).netloc}/"
    assert {url[:5] for url in browser.requests if own in url} >= {"http:", "ws://", "blob:"}
    assert all(url.startswith(("data:", f"http{own}", f"ws{own}", f"blob:http{own}")) for url in browser.requests)


def show(browser: Browser, address: str, *size: int) -> None:
    """Open a view, and wait until it is drawn."""
    browser.address = address
    browser.open(address, *size)
    wait(browser, "document.querySelectorAll('[role=slider], table').length > 0")
    wait(browser, "document.querySelector('.mantine-Notification-closeButton')")  # that there is no graphics card
    browser.run("document.querySelector('.mantine-Notification-closeButton').click()")
    browser.run("new Promise(d => setTimeout(d, 1500))")


def wait(browser: Browser, condition: str) -> None:
    for _ in range(150):
        if browser.run(f"Boolean({condition})"):
            return
        browser.run("new Promise(d => setTimeout(d, 100))")
    raise AssertionError(f"{condition} did not come true")


def pixels(browser: Browser) -> np.ndarray:
    """Return what is left of the panel, (height, width) of brightness."""
    found = browser.call("Page.captureScreenshot", format="png")["data"]
    picture = Image.open(io.BytesIO(base64.b64decode(found))).convert("L")
    return np.asarray(picture, dtype=int)[:, : picture.width * 2 // 3]


@pytest.fixture(scope="module")
def view():
    """Return the view of a robot, which a thread keeps up to date."""
    one, ended = vdfmu.RobotView(vdfmu.load_robot("planar_2dof")), threading.Event()
    thread = threading.Thread(target=one.run, args=(ended.is_set,))
    thread.start()
    yield one
    ended.set()
    thread.join()
    one.close()


def test_a_slider_moves_the_arm(view, browser):
    show(browser, view.address)
    before = pixels(browser)
    # links, floor and foot, of some per cent of the picture
    assert (before < 235).mean() > 0.01
    browser.run("document.querySelector('[role=slider]').focus()")
    browser.key("End", 35)
    browser.run("new Promise(d => setTimeout(d, 1500))")
    assert view.pose[0] == pytest.approx(np.pi)  # the end of a joint without end stops
    assert (np.abs(pixels(browser) - before) > 30).mean() > 0.005


def test_a_mode_moves_the_arm_by_itself(view, browser):
    view.sliders[0].value = 0.0
    show(browser, view.address)
    still = pixels(browser)
    view._amplitude.value, view._mode.value = 0.5, view._mode.options[1]  # found while the page opened
    seen = []
    for _ in range(4):  # at a third of a cycle each
        browser.run("new Promise(d => setTimeout(d, 500))")
        seen.append(pixels(browser))
    view._mode.value = "none"
    assert max((np.abs(each - still) > 30).mean() for each in seen) > 0.002


def test_on_a_phone_the_arm_is_above_the_panel(view, browser):
    show(browser, view.address, 390, 844)
    assert browser.run("document.documentElement.scrollWidth") <= 390
    upper = pixels(browser)[:330]
    assert (upper < 200).mean() > 0.005


@pytest.mark.skipif(sys.platform == "win32", reason="the terminal of this test is a Unix one")
def test_a_run_is_seen_while_it_goes_on_and_after_it(browser, tmp_path):
    import pty

    _, terminal = pty.openpty()
    log = tmp_path / "log"
    words = "run planar_tracking --live --pace 0.1 --stop 2 --no-reference"
    with open(log, "w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "vdfmu.cli", *words.split()], stdin=terminal, stdout=file,
            stderr=subprocess.STDOUT, cwd=tmp_path,
        )  # fmt: skip
    try:
        while not (found := re.search(r"http://\S+/", log.read_text())):
            assert process.poll() is None, log.read_text()
            time.sleep(0.1)
        browser.address = found[0]
        show(browser, found[0])
        wait(browser, "document.body.innerText.includes('Running')")
        before = pixels(browser)
        browser.run("new Promise(d => setTimeout(d, 5000))")  # half a second of the run
        assert (np.abs(pixels(browser) - before) > 30).mean() > 0.001
        wait(browser, "document.body.innerText.includes('The run is complete')")
        after = pixels(browser)
        browser.run("document.querySelector('[role=slider]').focus()")
        browser.key("Home", 36)
        browser.run("new Promise(d => setTimeout(d, 1500))")
        assert (np.abs(pixels(browser) - after) > 30).mean() > 0.002
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0, log.read_text()
    finally:
        process.kill()
        process.wait()
    assert "The view stays" in log.read_text()
