"""The page of a robot: sliders that move the arm, its end effector, its parts and its modes."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vdfmu
from tests.conftest import ran, refused
from tests.study.conftest import browser as browser
from tests.study.page.browser import WIDE, Browser, pixels, show
from tests.study.page.conftest import quiet as quiet
from vdfmu.base.errors import UsageError
from vdfmu.base.files import data_path
from vdfmu.extras.robots.robot_page import mode_facts, robot_page, write_robot_page

in_browser = pytest.mark.usefixtures("quiet")


def content(page: bytes) -> dict:
    return json.loads(page.decode().split('type="application/json">')[1].split("</script>")[0])


def test_sliders_end_within_the_limits_and_without_limits_the_page_says_so():
    panda = vdfmu.load_robot("panda_7dof")
    facts = content(robot_page(panda, None, None)[0])["robot"]
    assert facts["limits"]
    for slider, low, high in zip(facts["sliders"], panda.q_min, panda.q_max, strict=True):
        assert slider["unit"] == "deg"
        # ends are tenths of a degree, on the inner side of the limit
        assert 0.0 <= slider["low"] - np.rad2deg(low) < 0.1 and 0.0 <= np.rad2deg(high) - slider["high"] < 0.1
    free = content(robot_page(vdfmu.load_robot("planar_2dof"), None, None)[0])["robot"]
    assert not free["limits"]
    assert [(slider["low"], slider["high"]) for slider in free["sliders"]] == [(-180.0, 180.0)] * 2


def test_modes_are_those_of_the_start_pose():
    robot, pose = vdfmu.load_robot("planar_2dof"), (0.5, -0.25)
    facts = content(robot_page(robot, pose, None)[0])["robot"]
    assert tuple(slider["start"] for slider in facts["sliders"]) == pose
    for motors, modes in facts["modes"].items():
        expected = vdfmu.natural_modes(robot, pose, motors=motors)
        assert [mode["frequency"] for mode in modes] == expected.frequency.tolist()
    assert {*facts["modes"]} == {"free", "held"}


def test_a_pose_that_does_not_fit_is_refused_before_a_file_is_written(tmp_path):
    panda, page = vdfmu.load_robot("panda_7dof"), tmp_path / "panda.html"
    for pose, words in (
        ((0.0, 0.0), "pose must have 7 numbers, one for each joint of panda_7dof, got 2"),
        ((9.0, *panda.q_min[1:]), "pose: joint 1 must be at -2.897 to 2.897 rad, got 9"),
        ((*panda.q_min[:6], np.nan), "joint 7 must be at -2.897 to 2.897 rad, got nan"),
    ):
        with pytest.raises(UsageError, match=words):
            write_robot_page(panda, page, pose=pose)
    assert not page.exists()


def test_the_command_writes_the_page_and_leaves_the_files_of_others(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    done = ran("robot", "show", "planar_2dof", "--page", "--open")
    assert done.stdout.splitlines() == ["Written to planar_2dof.html", "Open planar_2dof.html"]
    assert opened == [(tmp_path / "planar_2dof.html").as_uri()]
    ran("robot", "show", "planar_2dof", "--page", "--pose", "0.5 -0.25")  # a page of vdfmu is replaced
    page = (tmp_path / "planar_2dof.html").read_bytes()
    assert [slider["start"] for slider in content(page)["robot"]["sliders"]] == [0.5, -0.25]
    assert b"http" not in page.partition(b'<script id="data"')[0].replace(b"http-equiv", b"")  # nothing is loaded
    (tmp_path / "mine.html").write_text("mine")
    assert "replace it with --overwrite" in refused("robot", "show", "planar_2dof", "--page", "-o", "mine.html")
    assert (tmp_path / "mine.html").read_text() == "mine"
    for words in (("-o", "x.html"), ("--pose", "0 0"), ("--open",)):
        assert f"{words[0]} goes with --page" in refused("robot", "show", "planar_2dof", *words)


def test_what_a_page_lacks_is_in_the_terminal_and_on_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (data_path("models") / "robots" / "planar_2dof.toml").read_text(encoding="utf-8")
    mesh = '[[visuals]]\njoint = 1\nshape = "mesh"\nfile = "no.stl"\nsize = [1.0, 1.0, 1.0]\n'
    (tmp_path / "arm.toml").write_text(f"{text}\n{mesh}")
    done = ran("robot", "show", "arm.toml", "--page")
    assert "note: mesh no.stl cannot be shown" in done.stderr
    assert b"<li>mesh no.stl cannot be shown" in (tmp_path / "planar_2dof.html").read_bytes()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "arm.html"
    write_robot_page(vdfmu.load_robot("panda_7dof"), path)
    return path


def chip(browser: Browser, name: str) -> None:
    browser.run(f"[...document.querySelectorAll('.chip')].find((c) => c.textContent === {name!r}).click()")
    browser.settle()


@pytest.mark.heavy
@in_browser
def test_a_slider_moves_the_arm_and_the_end_effector_is_where_the_equations_have_it(page, browser):
    show(browser, page, *WIDE)
    before = pixels(browser, ".canvas")
    assert (before < 235).mean() > 0.01  # links, floor and plate are some per cent of the picture
    browser.run("document.querySelectorAll('#joints [type=range]')[1].focus()")
    browser.key("End", 35)
    panda = vdfmu.load_robot("panda_7dof")
    q = np.array(browser.run("report.state.q"))
    assert q[1] == pytest.approx(np.deg2rad(101.0))  # its limit of 1.763 rad, inwards to a tenth of a degree
    assert browser.run("document.querySelectorAll('#joints [type=range]')[1].ariaValueText") == "101.0 deg"
    assert (np.abs(pixels(browser, ".canvas") - before) > 30).mean() > 0.005
    position, rotation = vdfmu.dynamics.forward_kinematics(panda, q)
    shown = browser.run("report.scene.toolPose()")
    # seven products of matrices with entries of at most 1 m, in double precision
    np.testing.assert_allclose(shown["position"], position, atol=1e-14)
    turn = Rotation.from_euler("xyz", shown["angles"]).as_matrix()  # roll, pitch and yaw about fixed axes
    np.testing.assert_allclose(turn, rotation, atol=1e-14)
    x = browser.run("document.querySelector('.tool output').textContent")
    assert x == f"{1e3 * position[0]:.1f} mm".replace("-", "−")


@pytest.mark.heavy
@in_browser
def test_parts_are_shown_and_hidden(page, browser):
    show(browser, page, *WIDE, scheme="dark")
    seen = [pixels(browser, ".canvas")]
    for name in ("frames", "centres of mass", "ellipsoids of inertia", "gravity"):
        chip(browser, name)
        seen.append(pixels(browser, ".canvas"))
    browser.run("document.querySelector('#arm select').value = 'hidden'")
    browser.run("document.querySelector('#arm select').dispatchEvent(new Event('change'))")
    browser.settle()
    seen.append(pixels(browser, ".canvas"))
    # a ball of 1.4 % of the reach is the least: some hundred pixels of 4e5
    assert all((np.abs(b - a) > 20).mean() > 1e-4 for a, b in zip(seen, seen[1:], strict=False))


@pytest.mark.heavy
@in_browser
def test_a_mode_moves_the_arm_by_its_shape_about_the_start_pose(page, browser):
    show(browser, page, *WIDE)
    start = browser.run("report.state.q")
    browser.run("report.pose(report.state.q.map((q) => q + 0.1))")
    browser.run("document.querySelector('.chip.mode').click()")
    assert browser.run("report.state.q") == start
    most = browser.run(
        "new Promise((d) => { let most = 0; const began = performance.now(); const look = (now) => { "
        "most = Math.max(most, ...report.scene.q.map((q, i) => Math.abs(q - report.state.q[i]))); "
        "now < began + 4000 ? requestAnimationFrame(look) : d(most); }; requestAnimationFrame(look); })"
    )
    # the amplitude is 0.2 of the largest part of the shape, in the frames that were drawn
    assert 0.05 < most <= 0.2 * 1.001
    browser.run("report.pose(report.state.q)")  # as a slider does
    browser.settle()
    assert browser.run("report.state.chosen") == -1
    assert browser.run("report.scene.q") == start


@pytest.mark.heavy
@in_browser
def test_where_motion_is_not_wanted_a_mode_is_still(page, browser):
    show(browser, page, *WIDE, motion="reduce")
    browser.run("document.querySelector('.chip.mode').click()")
    browser.settle()
    still = browser.run("report.scene.q")
    assert still != browser.run("report.state.q")
    browser.settle()
    assert browser.run("report.scene.q") == still


def test_the_shape_of_a_mode_has_a_largest_part_of_1():
    modes = vdfmu.natural_modes(vdfmu.load_robot("planar_2dof"), (0.3, -0.5), motors="held")
    for k in range(len(modes.frequency)):
        facts = mode_facts(modes, k)
        shape = np.array(facts["real"]) + 1j * np.array(facts["imaginary"])
        # a division of each of two numbers
        assert np.abs(shape).max() == pytest.approx(1.0, rel=4 * np.finfo(float).eps)
        np.testing.assert_allclose(shape * np.abs(modes.links[k]).max(), modes.links[k], rtol=1e-15)
        assert facts["joint"] == modes.joint[k] + 1
