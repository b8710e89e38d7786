"""Rows, mounts, payloads and forces of the arms of a page; without a browser."""

import dataclasses

import numpy as np
import pytest

import vdfmu
from tests.study.page.shown import numbers, still_and_quick
from vdfmu.base.arrays import bends
from vdfmu.base.errors import UsageError
from vdfmu.base.text import to_json
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report import content
from vdfmu.study.report.content import FRAMES, content_of
from vdfmu.study.report.shapes import Chain, drawing_of
from vdfmu.study.run.scene import arm_of, carriers_first, scene_of
from vdfmu.study.run.summary_keys import read_summary
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario


def frames_of(results: Results) -> tuple[np.ndarray, np.ndarray]:
    frames = content_of(results, results.summary)["frames"]
    t = numbers(frames["time"], "<f8")
    return t, numbers(frames["q"]).reshape(2, len(t))


def test_an_arm_that_moves_for_2_of_300_s_is_drawn_where_it_is():
    results = still_and_quick(30_001, 300.0)
    t, q = frames_of(results)
    blocks = -(-30_001 // content.BLOCK)
    assert len(t) <= FRAMES + 1 + 500 + 2 * blocks
    shown = np.array([np.interp(results.time, t, row) for row in q])
    # The motion has 200 rows, fewer than the 500 that are kept between the even ones, 0.3 s apart. The error is the
    # smallest that counts, 1e-5 rad, and single precision.
    assert np.abs(shown - results["plant.q"].T).max() < 1e-5 + 2.0**-24
    # as they were, 1000 rows at equal distances in time, h = 0.3 s: off by up to 5.78 / 4 * 0.09 / 8 = 0.016 rad
    even = np.interp(results.time, results.time[::30], results["plant.q"][::30, 0])
    assert np.abs(even - results["plant.q"][:, 0]).max() > 0.005


def test_bends_halve_the_stretches_of_a_parabola_a_short_run_keeps_every_row_and_arms_are_fixed():
    t = np.linspace(0.0, 1.0, 1025)
    rows, distances = bends(t, np.array([t**2, -t]), np.array([0, 1024]), 63, 0.0)
    # the farthest point of a parabola from its chord is the middle, off by h^2 / 4 (second derivative 2): 63 = 2^6 - 1
    # rows make 64 equal stretches; rounding of numbers about 1
    assert sorted(rows) == list(range(16, 1024, 16))
    left = np.abs(np.interp(t, t[::16], t[::16] ** 2) - t**2).max()
    assert left == pytest.approx((1 / 64) ** 2 / 4, rel=1e-9)
    np.testing.assert_allclose(distances[:3], [1 / 4, 1 / 16, 1 / 16], atol=1e-15)
    assert len(bends(t, np.array([t]), np.array([0, 1024]), 63, 1e-12)[0]) == 0
    gap = np.where(t > 0.5, np.nan, t**2)
    assert len(bends(t, np.array([gap]), np.array([0, 512, 1024]), 3, 0.0)[0]) == 3
    t, q = frames_of(still_and_quick(1001, 2.0))
    assert len(t) == 1001 and q.shape == (2, 1001)
    down, up = [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]
    for name, side in (
        ("manipulator_6dof", down), ("ur5e_6dof", down), ("snake_24dof", up), ("planar_2dof", [0.0, 1.0, 0.0])
    ):  # fmt: skip
        robot = vdfmu.load_robot(name)
        mount = drawing_of(arm_of(robot, {}), np.full(robot.n, 0.5 if name == "snake_24dof" else 2.0))["mount"]
        np.testing.assert_allclose(mount if name != "planar_2dof" else np.abs(mount), side, atol=1e-15)
    robot = vdfmu.load_robot("scara_4dof")
    hanging = dataclasses.replace(robot, gravity=-robot.gravity)
    chain = Chain(arm_of(hanging, {}))
    assert chain.mount(np.ones(4)) @ chain.up > 0.99


def test_a_payload_is_a_box_of_its_inertia_and_a_base_moves_as_its_signals_say():
    sides, mass = np.array([0.1, 0.2, 0.3]), 2.0
    inertia = np.diag(mass / 12.0 * (sides @ sides - sides**2))
    robot = dataclasses.replace(
        vdfmu.load_robot("planar_2dof"), payload=True, payload_mass=mass, payload_inertia=inertia,
        payload_centroid=np.array([0.05, 0.0, 0.0]),
    )  # fmt: skip
    arm = arm_of(robot, {"payload_centroid[1]": 0.15})
    (box,) = [part for part in Chain(arm).parts(0.0, 1.0) if part.shape == "box"]
    # a handful of roundings; its axes may come in another order
    assert sorted(box.size) == pytest.approx(sides, rel=1e-12)
    np.testing.assert_allclose(box.offset, robot.tool_offset + robot.tool_rotation @ [0.15, 0.0, 0.0], atol=1e-15)
    point = {"payload_mass": 2.7} | {f"payload_inertia[{i},{i}]": 0.0 for i in (1, 2, 3)}
    (cube,) = [part for part in Chain(arm_of(robot, point)).parts(0.0, 1.0) if part.shape == "box"]
    assert cube.size == pytest.approx([0.1] * 3)  # 2.7 kg of aluminium
    results = still_and_quick(501, 2.5)
    base = [f"boat.p_S[{i}]" for i in (1, 2, 3)] + [f"boat.R_S[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3)]
    arm = results.summary["arm"] | {
        "component": "boat", "mounted": "", "signals": {"plant.q": ["plant.q[1]", "plant.q[2]"], "base": base},
        "constants": {"boat.R_S[1,1]": 1.0, "boat.R_S[2,2]": 1.0, "boat.R_S[3,3]": 1.0, "boat.p_S[3]": 0.5},
    }  # fmt: skip
    signals = [*results.signals, Signal("boat.p_S[1]", "real", "m", 2)]
    data = np.column_stack([results.data["real"], 0.1 * results.time])
    moved = Results(results.time, signals, {"real": data}, results.summary | {"scene": {"arms": [arm], "objects": []}})
    made = content_of(moved, moved.summary)
    poses = numbers(made["frames"]["base"]).reshape(12, -1)
    np.testing.assert_array_equal(poses[0], (0.1 * results.time).astype("<f4"))
    assert poses[1:, 7].tolist() == [0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert made["frames"]["recipes"]["base"][2] == [1.0, [[0.5, ""]]]


def test_the_scene_has_what_the_system_has_an_arm_after_the_one_that_carries_it():
    scene = scene_of(SystemDescription(load_scenario("two_arms")))
    assert [(arm["component"], arm["mounted"], len(arm["types"])) for arm in scene["arms"]] == [
        ("plant", "", 3), ("plant_2", "plant", 2)
    ]  # fmt: skip
    second = scene["arms"][1]["signals"]
    assert second["plant.q"] == ["plant_2.q[1]", "plant_2.q[2]"]
    assert second["trajectory.q_d"] == ["trajectory_2.q_d[1]", "trajectory_2.q_d[2]"]
    assert second["controller.tau"] == ["controller_2.tau[1]", "controller_2.tau[2]"]
    assert second["base"][:4] == ["plant.p_O[1]", "plant.p_O[2]", "plant.p_O[3]", "plant.R_O[1,1]"]
    assert len(second["base"]) == 12 and len(second["F_S"]) == 6
    assert "F_e" not in scene["arms"][0]["signals"]  # of a load with a mass it is a part of the wrench
    (wall,) = scene_of(SystemDescription(load_scenario("wall")))["objects"]
    assert (wall["kind"], wall["direction"], wall["distance"], wall["tool"]) == (
        "plane", [0.0, 0.0, 1.0], 0.73, "plant",
    )  # fmt: skip
    (screw,) = scene_of(SystemDescription(load_scenario("screw")))["objects"]
    assert (screw["kind"], screw["turn"], screw["pitch"]) == ("screw", "screw.turn", 0.5e-3)
    assert screw["forces"] == {"screw.N": "Axial force", "screw.T": "Torque about the axis"}
    arms = [{"component": name, "mounted": on} for name, on in ("cb", "ba", "a ", "xy", "yx")]
    ordered = carriers_first([arm | {"mounted": arm["mounted"].strip()} for arm in arms])
    assert [arm["component"] for arm in ordered] == ["a", "b", "c", "x", "y"]


@pytest.mark.heavy
def test_arms_and_forces_have_figures_and_lists_of_other_lengths_are_said(tmp_path):
    results = vdfmu.run("two_arms", stop=0.002, reference=False, out=tmp_path, backend="python")
    made = content_of(results, results.summary)
    keys = [figure["key"] for figure in made["figures"]]
    assert {"tracking.revolute", "tracking.prismatic", "plant_2.tracking.revolute", "plant_2.F_S.N"} <= set(keys)
    assert made["component"] == "plant" and [arm["component"] for arm in made["more"]] == ["plant_2"]
    assert read_summary(tmp_path / "summary.json")["scene"] == results.summary["scene"]
    results.summary["scene"]["arms"][1]["types"].append("revolute")
    results.summary["scene"]["arms"][0]["signals"]["F_e"] = ["plant.F_e[1]"]
    (tmp_path / "summary.json").write_text(to_json(results.summary))
    with pytest.raises(UsageError, match=r"(?s)arms\[1\]\.signals\.F_e: expected 6.*arms\[2\]: expected an entry"):
        read_summary(tmp_path / "summary.json")
    pushed = vdfmu.run("wall", stop=0.002, reference=False, out=False, backend="python")
    titles = [figure["title"] for figure in content_of(pushed, pushed.summary)["figures"]]
    assert titles[0] == "wall: normal force" and "surroundings" not in " ".join(titles)  # nothing is touched yet
