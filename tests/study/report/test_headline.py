"""The verdict on a run as a sentence, its numbers, and the command that makes it again; in terminal and page alike."""

import io
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

import vdfmu
from tests.conftest import ran
from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import load_robot
from vdfmu.base.measure import quantity
from vdfmu.base.toml_file import locate
from vdfmu.cli import runs
from vdfmu.engine.results.verdict import Check, checks_line, line_of, state_of, verdict_of
from vdfmu.study.analysis.reach import reach_scenario
from vdfmu.study.report.page import report_page, run_command
from vdfmu.study.report.parts import MOST_TILES, page_title, tiles_of
from vdfmu.study.report.sheets import facts, verdict_text
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.scenario_run import prepare
from vdfmu.study.run.summary import run_facts
from vdfmu.study.run.verdict import verdict

FIGURES = {
    "tool_error": {"value": 2.89e-6, "at_s": 4.941},
    "joint_error": {"value": 9.72e-5, "unit": "deg", "joint": 2, "at_s": 5.263},
    "torque": {"value": 35.5, "unit": "N.m", "joint": 2, "at_s": 0.941},
    "margin": {"value": 0.54, "place": "joint 5", "at_s": 1.2},
    "mode": {"value": 13.9, "at_s": 5.0},
}
UNSTABLE = {"value": 1.14, "place": "joint 5", "at_s": 0.49}
CHECK = {"good": Check("Energy residual of the coupling", "good", "small"),
         "failed": Check("Energy residual of the coupling", "failed", "31 %")}  # fmt: skip
STABLE = Check("Sampled loops", "good", "stable")
BOND = {"residual_energy_abs_j": [0.004, 0.004], "exchanged_energy_j": [16.0, 20.0]}


@pytest.mark.parametrize(("value", "unit", "peak", "text"), [
    (2.89e-6, "m", 0, "2.89 µm"), (0.00289, "mm", 0, "2.89 µm"), (9.72e-5, "deg", 0, "97.2 µdeg"),
    (999.6e-6, "m", 0, "1 mm"), (0.763, "deg", 0, "0.763 deg"), (0.0999, "deg", 0, "99.9 mdeg"),
    (-1234.5, "N.m", 0, "−1230 N.m"), (-12345.0, "N.m", 0, "−12.3 kN.m"), (2350.0, "deg", 0, "2350 deg"),
    (1.68e-18, "N.m", 1.0, "0 N.m"), (4.56e-13, "rad", 0, "4.56·10⁻¹³ rad"), (0.54, "", 0, "0.54"),
    (float("nan"), "m", 0, "–"),
])  # fmt: skip
def test_a_number_has_three_digits_and_a_unit_that_fits(value, unit, peak, text):
    assert quantity(value, unit, peak) == text


def test_a_tool_that_the_last_joint_does_not_move_makes_a_run_doubtful():
    arm = load_robot("planar_2dof").with_parameters(tool_offset=[0.0, 0.0, 0.1])
    summary = {"key_figures": FIGURES, "power_bond": BOND, "step": 1e-3}
    summary["verdict"] = verdict(summary, [STABLE], arm)
    assert line_of(summary).startswith("Doubtful: the tool lies on the axis of joint 2; stable; tool error 2.89 µm")
    assert checks_line(summary) == "2 of 3 checks pass, 1 doubtful"
    for good in (replace(arm, tool_on_last_axis=True), load_robot("planar_2dof")):
        assert state_of({"verdict": verdict(summary, [STABLE], good)}) == "good"


def test_a_good_run_is_told_by_its_numbers():
    summary = {"key_figures": FIGURES, "power_bond": BOND, "step": 1e-3}
    summary["verdict"] = verdict(summary, [STABLE])
    assert (state_of(summary), line_of(summary)) == (
        "good", "Good: stable; tool error 2.89 µm at most, at 4.94 s; joint 2 worst, 97.2 µdeg; modulus margin 0.54"
    )  # fmt: skip
    assert checks_line(summary) == "2 of 2 checks pass"
    tiles = list(tiles_of(summary))
    assert [tile[:4] for tile in tiles] == [
        ("Tool error", "2.89 µm", "at 4.94 s", "tool"),
        ("Worst joint", "97.2 µdeg", "joint 2 at 5.26 s", "tracking"),
        ("Modulus margin", "0.54", "joint 5 at 1.2 s", "torque"),
        ("Peak torque", "35.5 N.m", "joint 2 at 0.941 s", "torque"),
    ]
    assert [tile.at for tile in tiles] == [4.941, 5.263, 1.2, 0.941]
    assert dict(facts({"key_figures": FIGURES}))["Lowest mode"] == "13.9 Hz at 5 s, motors held"


def test_tiles_begin_with_what_the_components_of_the_system_do():
    wall = {"key_figures": FIGURES | {"contact": CONTACT, "depth": DEPTH}}
    assert [tile[:4] for tile in tiles_of(wall)] == [
        ("Contact force", "85.8 N", "at the tool, since 0.53 s", "plant.F_e.N"),
        ("Penetration", "4.29 mm", "at 1.9 s", "wall."),
        ("Tool error", "2.89 µm", "at 4.94 s", "tool"),
        ("Worst joint", "97.2 µdeg", "joint 2 at 5.26 s", "tracking"),
    ]
    assert page_title("wall", wall) == "wall: contact force 85.8 N"
    estimate = {
        "component": "eye",
        "group": "tau_s_hat",
        "words": "Spring torque, link-side",
        "signals": [],
        "true": [],
    }
    seen = {"scene": {"estimates": [estimate]}, "rms_tau_s_hat_error_nm": [0.1, 1.8], "key_figures": FIGURES}
    assert tiles_of(seen)[0][:5] == (
        "Spring torque", "1.8 N.m", "RMS error, joint 2", "estimate.eye.tau_s_hat", "apart",
    )  # fmt: skip
    cut = {"power": {"value": 12.0, "unit": "W", "joint": 3, "at_s": 0.5},
           "cut": {"value": 90.0, "unit": "N", "joint": 1, "at_s": 0.1}}  # fmt: skip
    assert [tile[:4] for tile in tiles_of({"key_figures": cut})] == [
        ("Power at a cutting point", "12 W", "joint 3 at 0.5 s", "power"),
        ("Force at a cutting point", "90 N", "joint 1 at 0.1 s", "force"),
    ]


SATURATED = {"value": 0.69, "place": "torque limit of joint 1", "at_s": 0.621}
LOOPS = Check("Sampled loops", "failed", "unstable: a long text", "unstable since 0.49 s, joint 5")
BLIND = Check("Sampled loops", "doubtful", "not judged: blind", "stability not judged (no derivatives)")
LIMIT = "saturated, at the torque limit of joint 1 for 69 % of the time"
OFF = {"value": 1.2, "size": 1.66, "unit": "m", "place": "tool", "at_s": 2.0}
CONTACT = {"value": 85.8, "unit": "N", "at_s": 0.53}
DEPTH = {"value": 0.00429, "unit": "m", "place": "wall.depth", "at_s": 1.9}


@pytest.mark.parametrize(("figures", "loops", "line"), [
    ({"unstable": UNSTABLE}, [LOOPS], "Failed: unstable since 0.49 s, joint 5"),
    # the limit is a consequence, or the cause
    ({"unstable": UNSTABLE, "saturated": SATURATED}, [LOOPS],
     f"Failed: unstable since 0.49 s, joint 5; {LIMIT}, since 0.621 s"),
    ({"unstable": UNSTABLE, "saturated": SATURATED | {"at_s": 0.0}}, [LOOPS],
     f"Failed: {LIMIT}, from the start; unstable since 0.49 s, joint 5"),
    ({"saturated": SATURATED, "joint_error": FIGURES["joint_error"], "margin": FIGURES["margin"]}, [STABLE],
     f"Doubtful: {LIMIT}, since 0.621 s; joint 2 worst, 97.2 µdeg"),
    ({"path": OFF}, [], "Failed: off its path, tool off by 1.2 m at most, in a motion of 1.66 m, at 2 s"),
    ({"path": OFF | {"value": 0.17}, "tool_error": {"value": 0.17, "at_s": 2.0}}, [],
     "Doubtful: off its path, tool off by 0.17 m at most, in a motion of 1.66 m, at 2 s"),
    ({"path": OFF | {"value": 0.16}, "margin": FIGURES["margin"]}, [STABLE], "Good: stable; modulus margin 0.54"),
    ({"path": OFF | {"value": 0.17}, "contact": CONTACT}, [],
     "Good: in contact as meant since 0.53 s, 85.8 N at most"),
    ({"path": OFF, "contact": CONTACT}, [],  # even there an arm has to follow
     "Failed: off its path, tool off by 1.2 m at most, in a motion of 1.66 m, at 2 s"),
    ({"path": OFF | {"value": 0.8, "place": "joint 6"}}, [STABLE], "Good: stable"),
    ({}, [BLIND], "Doubtful: stability not judged (no derivatives)"),
])  # fmt: skip
def test_what_a_run_is_known_by_is_told_first(figures, loops, line):
    summary = {"key_figures": figures}
    summary["verdict"] = verdict(summary, [*loops])
    assert line_of(summary) == line
    assert line.startswith(state_of(summary).capitalize())


def test_a_check_that_failed_is_quoted_and_numbers_that_are_not_known_have_no_tile():
    summary = {"key_figures": {}, "witness": None}
    assert line_of({"verdict": verdict_of([CHECK["failed"]])}) == "Failed: Energy residual of the coupling: 31 %"
    both = verdict_of([LOOPS, CHECK["failed"]], "numbers")
    assert line_of({"verdict": both}) == "Failed: unstable since 0.49 s, joint 5"
    doubtful = Check("Limits", "doubtful", "", "saturated")
    both = verdict_of([doubtful, CHECK["failed"]])
    assert line_of({"verdict": both}) == "Failed: saturated; Energy residual of the coupling: 31 %"
    assert checks_line({"verdict": both}) == "0 of 2 checks pass, 1 doubtful, 1 failed"
    summary["verdict"] = verdict(summary, [])
    assert (state_of(summary), checks_line(summary)) == ("doubtful", "")
    assert line_of(summary) == "Doubtful: not judged, since no check applies to this run"
    assert not [*tiles_of({})] and not line_of({}) and not state_of({}) and not verdict_text({})
    (tile,) = tiles_of({"key_figures": {"margin": FIGURES["margin"] | {"value": 0.0}}})
    assert tile.value == "none"
    tiles = tiles_of({"key_figures": {"contact": CONTACT, "saturated": SATURATED, "unstable": UNSTABLE}})
    assert [tile[:3] for tile in tiles] == [
        ("Disturbances grow", "× 1.14", "a step, joint 5, since 0.49 s"),
        ("Time at a limit", "69 %", "torque limit of joint 1, since 0.621 s"),
        ("Contact force", "85.8 N", "at the tool, since 0.53 s"),
    ]


def test_the_line_in_the_terminal_has_a_colour_and_key_figures_are_those_of_the_results(planar):
    checks = [CHECK["good"], Check("a", "doubtful", "b", "saturated")]
    with Console(file=io.StringIO(), width=80, color_system="standard", force_terminal=True) as console:
        with console.capture() as shown:
            console.print(verdict_text({"verdict": verdict_of(checks)}))
    yellow = 33
    assert f"\x1b[{yellow}m! \x1b[0m" in shown.get()
    assert "Doubtful: saturated; 1 of 2 checks pass, 1 doubtful" in shown.get()
    (tile,) = tiles_of({"key_figures": {"torque": FIGURES["torque"] | {"limit": 71.0}}})
    assert tile[1:3] == ("35.5 N.m", "50 % of its limit, joint 2 at 0.941 s")
    results, _ = planar
    figures = results.summary["key_figures"]
    row = round(figures["tool_error"]["at_s"] / results.summary["step"])
    robot = vdfmu.load_robot("planar_2dof")
    ends = [forward_kinematics(robot, results[name][row])[0] for name in ("trajectory.q_d", "plant.q")]
    assert figures["tool_error"]["value"] == pytest.approx(((ends[0] - ends[1]) ** 2).sum() ** 0.5, rel=1e-9)
    worst = figures["joint_error"]
    assert worst["value"] == max(results.summary["max_position_error_deg"])
    assert worst["joint"] == results.summary["max_position_error_deg"].index(worst["value"]) + 1
    torque = figures["torque"]
    peak = abs(robot.ell * results["controller.tau"])
    assert torque["value"] == peak.max() and peak[:, torque["joint"] - 1].max() == peak.max()
    modes = vdfmu.natural_modes(robot, results["plant.q"][0], motors="held")
    # the arm has moved by less than a degree in 0.2 s
    assert figures["mode"]["value"] == pytest.approx(modes.frequency[0], rel=0.01)
    assert 0.0 < figures["margin"]["value"] <= 1.0


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("headline")
    return vdfmu.run("planar_tracking", stop=0.2, out=folder, reference=False), folder


def test_another_plant_has_its_own_modes_and_a_tool_error_unless_its_geometry_is_another(planar):
    short: dict[str, Any] = {"stop": 0.05, "out": False, "reference": False}
    rigid = planar[0].summary["key_figures"]["mode"]["value"]
    soft = vdfmu.run("planar_tracking", settings={f"plant.K_f0[{i}]": 500.0 for i in (1, 2)}, **short)
    figures, robot = soft.summary["key_figures"], vdfmu.load_robot("planar_2dof").with_parameters(K_f0=500.0)
    assert figures["tool_error"]["value"] > 0.0 and figures["mode"]["value"] < rigid
    # among five poses of a motion that has moved the arm by less than 0.01 degrees
    expected = vdfmu.natural_modes(robot, soft["plant.q"][0], motors="held").frequency[0]
    assert figures["mode"]["value"] == pytest.approx(expected, rel=1e-3)
    longer = vdfmu.run("planar_tracking", settings={"plant.offset[2,1]": 0.6}, **short)
    assert "tool_error" not in longer.summary["key_figures"] and "mode" in longer.summary["key_figures"]


def test_the_page_begins_with_the_verdict_and_the_command_that_makes_the_run_again(planar):
    results, folder = planar
    page = (folder / "report.html").read_text()
    assert f'<p class="verdict good" data-run="0">{line_of(results.summary)}</p>' in page
    assert f"<title>{page_title('planar_tracking', results.summary)}</title>" in page
    assert page.count('class="tile"') == len(tiles_of(results.summary)) == MOST_TILES
    assert '<details class="checks good"><summary>' in page
    bad = verdict_of([CHECK["failed"]])
    page = report_page([ShownRun("bad", results, results.summary | {"verdict": bad}, folder / "system.ssp")]).decode()
    assert '<p class="verdict failed" data-run="0">Failed: Energy residual of the coupling: 31 %</p>' in page
    assert '<details class="checks failed" open>' in page
    assert run_command(planar[0].summary) == "vdfmu run planar_tracking --stop 0.2"
    summary = planar[0].summary | {"scenario": "my own", "settings": {"controller.K_p[1]": "3"}}
    # a scenario that no file has any more: all its options
    all_options = "--robot planar_2dof --stop 0.2 --step 0.001 --master gauss-seidel --tolerance 1e-07"
    assert run_command(summary) == f"vdfmu run 'my own' {all_options} --set 'controller.K_p[1]=3'"
    units = summary | {"units": {"controller": "pid.py"}}
    assert run_command(units).endswith("--tolerance 1e-07 --unit controller=pid.py --set 'controller.K_p[1]=3'")
    assert run_command(summary | {"inputs": ["a.csv"]}) == run_command({"system": "loop"}) == ""


def test_the_command_has_each_option_that_differs(planar, tmp_path):
    shipped = dict(planar[0].summary) | {"backend": "native"}
    assert run_command(shipped | {"stop": 0.1234567891, "backend": "python", "fmi": "3.0"}) == (
        "vdfmu run planar_tracking --stop 0.1234567891 --backend python --fmi 3.0"
    )
    (tmp_path / "bot.toml").write_text(locate("planar_2dof", "robots").read_text())
    robot = load_robot(tmp_path / "bot.toml")
    assert robot.file == str(tmp_path / "bot.toml") and not load_robot("planar_2dof").file
    path = tmp_path / "my.toml"
    text = locate("planar_tracking", "scenarios").read_text()
    path.write_text(text.replace('robot = "planar_2dof"', 'robot = "bot.toml"'))
    facts = run_facts(prepare(path, stop=0.3, master="jacobi", tolerance=1e-5))
    assert run_command(facts) == f"vdfmu run {path} --stop 0.3 --master jacobi --tolerance 1e-05"
    assert run_command(run_facts(prepare(path))) == f"vdfmu run {path}"
    assert run_command(run_facts(prepare(path, robot=robot))) == f"vdfmu run {path} --robot {robot.file}"
    reach = run_facts(prepare(reach_scenario(robot.file)))
    assert run_command(reach).startswith(f"vdfmu run reach --robot {robot.file} --stop ")
    reach = run_facts(prepare(reach_scenario("planar_2dof"), step=0.002))
    assert "vdfmu run reach --robot planar_2dof --stop" in run_command(reach) and "--step 0.002" in run_command(reach)


def test_a_command_ends_with_the_verdict_and_what_opens_the_page(planar, monkeypatch):
    opened = []
    monkeypatch.setattr(runs.webbrowser, "open", lambda address: opened.append(address) or True)
    said = ran("report", planar[1], "--no-simulate", "--open")
    page = planar[1] / "report.html"
    assert said.output.splitlines()[-1] == f"Open {page}" and opened == [page.as_uri()]
