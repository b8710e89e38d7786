"""The arms in the scene of a page: where they, their paths, and what they touch are; in a browser."""

from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import show
from tests.study.page.shown import still_and_quick
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report.page import write_report
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.scene import arm_of

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
SCENE = """const scene = report.player.scene, [{ arms, objects }] = scene.puppets;
    const at = (object, x = 0, y = 0, z = 0) => object.localToWorld(new vendor.Vector3(x, y, z)).toArray();"""


def asked(browser, expression: str):
    return browser.run(f"(() => {{ {SCENE} return {expression}; }})()")


def shown_at(browser, time: float) -> None:
    browser.run(f"report.view.change('time', {time!r})")


def swinging(name: str, amplitude: float) -> ShownRun:
    robot = vdfmu.load_robot(name)
    t = np.linspace(0.0, 2.0, 201)
    signals = [Signal(f"plant.q[{i + 1}]", "real", "rad", i) for i in range(robot.n)]
    summary = {"robot": name, "joints": robot.n, "arm": arm_of(robot, {})}
    q = np.outer(np.sin(3.0 * t), np.full(robot.n, amplitude))
    return ShownRun(name, Results(t, signals, {"real": q}, summary), summary, Path("none.ssp"))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    made = {name: tmp_path_factory.mktemp(name) for name in ("wall", "screw", "two_arms")}
    for name, folder in made.items():
        vdfmu.run(name, stop=2.2 if name == "wall" else 0.3, out=folder, reference=False)
    return made


INSIDE = """(() => {
    const scene = report.player.scene, [{ arms: [{ actual, plate, arm, motion }] }] = scene.puppets;
    const { radiusTop, height } = plate.geometry.parameters, links = [...actual.links, actual.tool];
    const thick = 0.68 * 0.06 * arm.reach; // radius of the first link
    const end = (link) => plate.worldToLocal(new vendor.Vector3().setFromMatrixPosition(link.matrixWorld));
    return Array.from(motion.time, (t) => {
        scene.show(t);
        const ends = links.map(end);
        let found = 0;
        for (let k = 1; k < ends.length; k += 1)
            for (let share = 0; share <= 1; share += 0.05) {
                const point = ends[k - 1].clone().lerp(ends[k], share);
                found += Math.hypot(point.x, point.z) < radiusTop && Math.abs(point.y) < height / 2 + thick;
            }
        return found;
    });
})()"""
"""At each row: points of links that are in the plate, and how opaque it is."""


@pytest.mark.parametrize(("name", "amplitude"), [("planar_2dof", 0.4), ("planar_2dof", 3.0), ("snake_24dof", 0.05)])
def test_no_link_is_in_the_plate_of_its_arm(browser, tmp_path, name, amplitude):
    show(browser, write_report([swinging(name, amplitude)], tmp_path / "arm.html"))
    assert browser.run(INSIDE) == [0] * 201


def test_the_path_ends_at_the_tool_and_leads_through_where_it_was(browser, tmp_path):
    results = still_and_quick(30_001, 300.0)
    show(browser, write_report([ShownRun("run", results, results.summary, Path("none.ssp"))], tmp_path / "arm.html"))
    reach = asked(browser, "arms[0].arm.reach")
    for time in (0.0, 0.6, 0.9, 1.7, 2.4, 150.0, 300.0):
        shown_at(browser, time)
        tool, end, begin, node, length = asked(
            browser,
            "[at(arms[0].actual.tool), at(arms[0].path.end, 0, 0, 1), at(arms[0].path.end), "
            "arms[0].path.points[arms[0].path.tube.geometry.drawRange.count / 36].toArray(), arms[0].path.end.scale.z]",
        )
        # the end is set where the tool is: a rotation and a product in double precision
        np.testing.assert_allclose(end if length else node, tool, atol=1e-6 * reach)
        np.testing.assert_allclose(begin, node, atol=1e-12)
    # rows of the motion are those of the run, q in single precision: each is where the arm was, and the tube's rings
    # are around them, in single precision too; 1e-6 of about 1 m is several times that
    off = asked(
        browser,
        """(() => {
            const { path, motion } = arms[0], chain = new report.Chain(arms[0].arm);
            const at = path.tube.geometry.attributes.position;
            return Math.max(...path.points.map((point, k) => {
                const ring = new vendor.Vector3();
                for (let i = 0; i < 6; i += 1) ring.add(new vendor.Vector3().fromBufferAttribute(at, 7 * k + i));
                chain.set(motion.at("q", path.times[k]));
                const there = new vendor.Vector3().setFromMatrixPosition(chain.tool.matrixWorld);
                return Math.max(there.distanceTo(point), ring.divideScalar(6).distanceTo(point));
            }));
        })()""",
    )
    assert off < 1e-6 * reach
    # the way of the tool, in chords of less than 0.2 of the tube's radius or of one row, 0.01 s
    assert asked(browser, "arms[0].path.points.length") > 100


def test_a_wall_is_in_the_plane_of_contact_and_the_arrow_is_the_force(folders, browser):
    show(browser, folders["wall"] / "report.html")
    summary = vdfmu.Results.read(folders["wall"] / "results.csv")
    place, normal, count = asked(browser, "[at(objects[0]), at(objects[0], 0, 0, 1), objects.length]")
    assert count == 1
    assert place[2] == pytest.approx(0.73, abs=1e-12)
    np.testing.assert_allclose(np.subtract(normal, place), [0.0, 0.0, 1.0], atol=1e-12)
    force = summary["wall.F_e"][:, :3]
    peak = np.linalg.norm(force, axis=1).max()
    row = int(np.argmax(np.linalg.norm(force, axis=1)))
    shown_at(browser, float(summary.time[row]))
    tail, tip, tool, reach = asked(
        browser,
        "[at(arms[0].arrows[0].force), at(arms[0].arrows[0].force, 0, 1, 0), at(arms[0].actual.tool), scene.reach]",
    )
    np.testing.assert_allclose(tail, tool, atol=1e-12)
    rotation = summary["plant.R_O"][row]
    # 0.4 of the reach for the largest; between rows of the page, which are 1 % of the peak apart, and single precision
    np.testing.assert_allclose(np.subtract(tip, tail), 0.4 * reach * rotation @ force[row] / peak, atol=0.02 * reach)
    shown_at(browser, 0.5)
    assert not asked(browser, "arms[0].arrows[0].force.visible")


def test_a_screw_turns_where_the_tool_presses(folders, browser):
    show(browser, folders["screw"] / "report.html")
    results = vdfmu.Results.read(folders["screw"] / "results.csv")
    shown_at(browser, 0.3)
    head, turn = asked(browser, "[at(objects[0]), objects[0].children[0].rotation.z]")
    assert head[0] == pytest.approx(1.0598076, abs=1e-12)
    np.testing.assert_allclose(head[1:], results["plant.p_O"][-1, 1:], atol=2e-3)  # the bit sways by less
    assert turn == pytest.approx(results["screw.turn"][-1], abs=1e-6)  # single precision


def test_a_second_arm_is_on_the_tool_of_the_first(folders, browser):
    show(browser, folders["two_arms"] / "report.html")
    results = vdfmu.Results.read(folders["two_arms"] / "results.csv")
    for row in (0, 150, 300):
        shown_at(browser, float(results.time[row]))
        base, tool, second = asked(
            browser, "[arms[1].actual.root, arms[0].actual.tool, arms[1].actual.tool].map((object) => at(object))"
        )
        assert base == tool
        # positions of joints in single precision, at arms of some m
        np.testing.assert_allclose(tool, results["plant.p_O"][row], atol=1e-6)
        # the second plant has the base of a row before, with Jacobi's master; it turns with the base, twice as far out
        late = 2.0 * np.abs(np.diff(results["plant.p_O"], axis=0)).max()
        np.testing.assert_allclose(second, results["plant_2.p_O"][row], atol=1e-6 + late)
    assert asked(browser, "[arms.length, arms.map((arm) => !!arm.plate)]") == [2, [True, False]]
    joints = browser.run("[...document.querySelectorAll('.readout th')].map((e) => e.textContent)")
    assert joints == [*(f"plant,\u00a0{i}" for i in (1, 2, 3)), "plant_2,\u00a01", "plant_2,\u00a02"]


def test_views_and_the_canvas_turn_by_keys(browser, tmp_path):
    show(browser, write_report([swinging("manipulator_6dof", 0.4)], tmp_path / "arm.html"))
    away = "scene.camera.position.clone().sub(scene.controls.target).normalize().toArray()"
    for key, side in (("1", [1, 0, 0]), ("2", [0, -1, 0]), ("3", [0, 0, 1])):
        browser.key(key, ord(key))
        np.testing.assert_allclose(asked(browser, away), side, atol=2e-3)  # the top is looked at from 1e-3 aside
    browser.key("2", ord("2"))
    browser.run("document.querySelector('.canvas').focus()")
    browser.key("ArrowRight", 39)
    browser.settle()
    assert browser.run("report.view.time") == 0.0
    turned = np.degrees(np.arccos(np.dot(asked(browser, away), [0, -1, 0])))
    assert turned == pytest.approx(5.0, abs=0.01)
    assert "arrow keys" in browser.run("document.querySelector('.canvas').getAttribute('aria-label')")
