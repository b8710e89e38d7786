"""The verdict on a run as a sentence, its numbers, and the command that makes it again; in terminal and page alike."""

import io
import math
import re
from typing import Any

import pytest
from rich.console import Console

import vdfmu
from tests.conftest import ran
from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.measure import quantity
from vdfmu.base.toml_file import locate
from vdfmu.engine.results.verdict import LONGEST, Check, checks_line, headline_of, results_of, state_of, verdict_of
from vdfmu.study.limits import LIMITS, read_limits
from vdfmu.study.report.page import report_page, run_command
from vdfmu.study.report.parts import MOST_TILES, page_title, tiles_of
from vdfmu.study.report.sheets import facts, verdict_text
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.prepare import prepare
from vdfmu.study.run.summary import run_facts
from vdfmu.study.verdict import verdict

FIGURES = {
    "tool_error": {"value": 2.89e-6, "at_s": 4.941},
    "joint_error": {"value": 9.72e-5, "unit": "deg", "joint": 2, "at_s": 5.263},
    "torque": {"value": 35.5, "unit": "N.m", "joint": 2, "at_s": 0.941},
    "margin": {"value": 0.54, "place": "joint 5", "at_s": 1.2},
    "mode": {"value": 13.9, "at_s": 5.0},
}
UNSTABLE = {"value": 1.14, "place": "joint 5", "at_s": 0.49}
CHECK = {state: Check("energy", "Coupling energy", state, f"coupling energy error {share}", "", value, 0.1, "us")
         for state, share, value in (("good", "0.022 %", 2.2e-4), ("failed", "31 %", 0.31))}  # fmt: skip
BOND = {"residual_energy_abs_j": [0.004, 0.004], "exchanged_energy_j": [16.0, 20.0]}
SOLVED = {"reference": {}}
"""A run whose reference was asked for."""


@pytest.mark.parametrize(("value", "unit", "peak", "text"), [
    (2.89e-6, "m", 0, "2.89 µm"), (0.00289, "mm", 0, "2.89 µm"), (9.72e-5, "deg", 0, "97.2 µdeg"),
    (999.6e-6, "m", 0, "1 mm"), (0.763, "deg", 0, "0.763 deg"), (0.0999, "deg", 0, "99.9 mdeg"),
    (-1234.5, "N.m", 0, "−1230 N.m"), (-12345.0, "N.m", 0, "−12.3 kN.m"), (2350.0, "deg", 0, "2350 deg"),
    (1.68e-18, "N.m", 1.0, "0 N.m"), (4.56e-13, "rad", 0, "4.56e-13 rad"), (0.54, "", 0, "0.54"),
    (float("nan"), "m", 0, "–"),
])  # fmt: skip
def test_a_number_has_three_digits_and_a_unit_that_fits(value, unit, peak, text):
    assert quantity(value, unit, peak) == text


def test_a_good_run_is_told_by_its_numbers():
    summary = {"key_figures": FIGURES, "power_bond": BOND, "step": 1e-3}
    summary["verdict"] = verdict(summary)
    assert (state_of(summary), headline_of(summary), results_of(summary)) == (
        "good", "Good: modulus margin 0.54; maximum tool error 2.89 µm (at 4.94 s)",
        "worst joint 2, 97.2 µdeg; not judged: scipy reference",
    )  # fmt: skip
    assert checks_line(summary) == "3 of 3 checks pass"  # stable, its margin, and the energy
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
AT_LIMIT = "torque limit of joint 1 for 69 % of the run"
OFF = {"value": 1.2, "size": 1.66, "unit": "m", "place": "tool", "at_s": 2.0}
CONTACT = {"value": 85.8, "unit": "N", "at_s": 0.53}
DEPTH = {"value": 0.00429, "unit": "m", "place": "wall.depth", "at_s": 1.9}
MARGIN = FIGURES["margin"]
BLIND = {"stability": {"reason": "pid: expected FMUs with directional derivatives. Export them so.", "expected": False}}
OWED = {"stability": {"reason": "the native FMUs cannot be built: no compiler", "expected": True}}


@pytest.mark.parametrize(("more", "text"), [
    ("", "Error of 2 %"),
    ("limit 1 %", "Error of 2 %; limit 1 %"),
    ("Use a shorter step.", "Error of 2 %. Use a shorter step."),
])  # fmt: skip
def test_whole_sentences_follow_a_full_stop(more, text):
    assert Check("coupling", "Coupling error", "failed", "error of 2 %", more).text == text


@pytest.mark.parametrize(("figures", "more", "headline"), [
    ({"unstable": UNSTABLE}, {}, "Failed: unstable from 0.49 s on, joint 5"),
    # at a limit there is no feedback: the cause is told, whichever came first
    ({"unstable": UNSTABLE, "saturated": SATURATED}, {}, "Failed: unstable from 0.49 s on, joint 5"),
    ({"saturated": SATURATED, "margin": MARGIN}, {}, f"Doubtful: {AT_LIMIT}, from 0.621 s on (limit 1 %)"),
    ({"margin": MARGIN | {"value": 0.14}}, {}, "Doubtful: modulus margin 0.14 at joint 5, 1.2 s (limit 0.5)"),
    ({"margin": MARGIN, "delay": MARGIN | {"value": 0.51}}, {},
     "Doubtful: delay margin of 0.51 samples at joint 5, 1.2 s (limit 1)"),
    ({"margin": MARGIN, "excited": UNSTABLE}, {}, "Doubtful: friction-induced oscillation, growing fastest at joint 5"),
    ({"margin": MARGIN, "growth": {"value": 0.12, "place": "joint 1", "at_s": 1.14, "until_s": 1.44}}, {},
     "Doubtful: joint 1 is unstable from 1.14 s to 1.44 s (grows 12 %, limit 10 %)"),
    ({"margin": MARGIN | {"value": 1.0}, "open": UNSTABLE}, {}, "Doubtful: nothing is fed back to joint 5"),
    ({"path": OFF}, {}, "Failed: tool off its path by 1.2 m, 72.3 % of the motion, at 2 s (limit 50 %)"),
    ({"path": OFF | {"value": 0.17}, "tool_error": {"value": 0.17, "at_s": 2.0}}, {},
     "Doubtful: tool off its path by 0.17 m, 10.2 % of the motion, at 2 s (limit 10 %)"),
    ({"path": OFF | {"value": 0.16}, "margin": MARGIN}, {}, "Good: modulus margin 0.54; not judged: scipy reference"),
    ({"path": OFF | {"value": 0.17}, "contact": CONTACT}, {},
     "Good: in contact from 0.53 s on, 85.8 N at most; not judged: scipy reference"),
    ({"path": OFF, "contact": CONTACT}, {},  # even there an arm has to follow
     "Failed: tool off its path by 1.2 m, 72.3 % of the motion, at 2 s (limit 50 %)"),
    ({"path": OFF | {"value": 0.8, "place": "joint 6", "unit": "deg"}, "margin": MARGIN}, SOLVED,
     "Good: modulus margin 0.54; not judged: scipy reference"),
    ({"path": OFF | {"value": 0.0, "rest": True}, "tool_error": {"value": 0.0, "at_s": 0.0}}, {},
     "Good: at rest; not judged: scipy reference"),
    ({"margin": MARGIN}, {"cut": {"end": 20.0, "stop": 2.0, "asked": False}},
     "Doubtful: the motion of 20 s is cut at 2 s"),
    ({"margin": MARGIN}, {"cut": {"end": 20.0, "stop": 2.0, "asked": True}},
     "Good: modulus margin 0.54; stopped at 2 s of a motion of 20 s; not judged: scipy reference"),
    ({"margin": MARGIN}, {"unfed": ["controller.q is not connected, so it keeps its start value"]},
     "Doubtful: controller.q is not connected, so it keeps its start value"),
    ({"margin": MARGIN | {"value": 0.2}}, {"implausible": ["joint 2: a mass of 3e+05 kg looks like grams."]},
     "Doubtful: joint 2: a mass of 3e+05 kg looks like grams."),  # the likely cause, before its consequence
    ({"path": OFF | {"value": 0.01}}, BLIND, "Good: not judged: stability, scipy reference"),
    ({"path": OFF | {"value": 0.01}}, OWED,
     "Doubtful: stability not judged: the native FMUs cannot be built: no compiler"),
    ({}, BLIND, "Doubtful: no check applies to this run"),
])  # fmt: skip
def test_the_headline_is_the_worst_check(figures, more, headline):
    summary = {"key_figures": figures} | more
    summary["verdict"] = verdict(summary)
    assert headline_of(summary) == headline
    assert headline.startswith(state_of(summary).capitalize()) and len(headline) <= LONGEST


def test_a_joint_at_its_limit_before_the_loop_grows_is_named_first():
    early = {"unstable": UNSTABLE, "saturated": SATURATED | {"at_s": 0.0}}
    late = early | {"saturated": SATURATED}
    keys = [[check["key"] for check in verdict({"key_figures": figures})["checks"]] for figures in (early, late)]
    assert keys == [["saturated", "stability", "reference"], ["stability", "saturated", "reference"]]


def test_a_loop_whose_disturbances_grow_is_stable_only_if_they_hardly_grow_and_is_not_called_unstable_then():
    said = {}
    for share, limits in ((0.0156, {}), (0.12, {}), (0.12, {"growth": 0.2})):
        growth = {"value": share, "place": "joint 1", "at_s": 0.282, "until_s": 2.0}
        summary = {"key_figures": {"margin": MARGIN, "growth": growth}}
        checks = verdict(summary, read_limits(limits, "--limit"))["checks"]
        said[share, *limits] = [check["sentence"] for check in checks if check["key"] in ("stability", "growth")]
    assert [*said.values()] == [
        ["stable", "disturbances at joint 1 grow by 1.56 %, 0.282 s to 2 s"],
        ["joint 1 is unstable from 0.282 s to 2 s (grows 12 %, limit 10 %)"],
        ["joint 1 is unstable from 0.282 s to 2 s (grows 12 %, limit 20 % by --limit)"],
    ]


def test_an_energy_error_too_small_for_a_share_has_none():
    sentences = {}
    for residual in (0.66e-3, 1.5e-3):
        bond = {"residual_energy_abs_j": [residual], "exchanged_energy_j": [0.151]}
        checks = verdict({"key_figures": {}, "power_bond": bond})["checks"]
        sentences[residual] = [check["sentence"] for check in checks if check["key"] == "energy"]
    assert [*sentences.values()] == [
        ["coupling energy error 660 µJ of 0.151 J exchanged"],
        ["coupling energy error 1.5 mJ, 0.993 % of 0.151 J exchanged"],
    ]


def test_a_limit_of_the_user_replaces_that_of_the_table_and_says_whose_it_is():
    summary = {"key_figures": {"margin": MARGIN | {"value": 0.34}}}
    assert verdict(summary)["state"] == "doubtful"
    lower = verdict(summary, read_limits({"margin": "0.3"}, "--limit"))
    assert lower["state"] == "good"
    (margin,) = (check for check in lower["checks"] if check["key"] == "margin")
    assert (margin["limit"], margin["by"]) == (0.3, "--limit")
    # what is good by this limit only is the first that is said, with the limit
    assert lower["headline"] == "Good: only because of --limit: modulus margin 0.34 at joint 5, 1.2 s (limit 0.3)"
    assert verdict({"key_figures": {"margin": MARGIN}}, read_limits({"margin": 0.3}, "--limit"))["headline"] == (
        "Good: modulus margin 0.54; not judged: scipy reference"
    )
    far = {"path": OFF | {"value": 0.34, "place": "tool"}, "tool_error": {"value": 0.34, "at_s": 2.0}}
    assert verdict({"key_figures": far}, read_limits({"tool": "30 %"}, "--limit"))["headline"] == (
        "Good: only because of --limit: tool off its path by 0.34 m, 20.5 % of the motion, at 2 s …"
    )
    higher = verdict(summary, read_limits({"margin": 0.4}, "[limits] of the scenario"))
    assert higher["headline"] == (
        "Doubtful: modulus margin 0.34 at joint 5, 1.2 s (limit 0.4 by [limits] of the scenario)"
    )
    for wrong, words in (({"margn": 1}, "'margn' is not a limit. Did you mean \"margin\"?"),
                         ({"margin": "x"}, "margin must be a positive number, got 'x'. The default is 0.5."),
                         ({"margin": float("nan")}, "must be a positive number"),
                         ({"margin": -1}, "must be a positive number")):  # fmt: skip
        with pytest.raises(UsageError, match=re.escape(words)):
            read_limits(wrong, "--limit")
    assert read_limits({"saturated": "5 %"}, "--limit")["saturated"].value == 0.05


@pytest.mark.parametrize("key", LIMITS)
def test_each_limit_judges_just_inside_and_just_outside(key):
    row, places = (
        LIMITS[key],
        dict.fromkeys(set(re.findall(r"{(\w+)}", LIMITS[key].sentence)) - {"value", "samples"}, "x"),
    )
    inside, outside = (1.0 + (1e-9 if row.at_least == above else -1e-9) for above in (True, False))
    assert [row.check(row.value * factor, **places).state for factor in (inside, outside)] == ["good", row.beyond]
    assert row.check(math.nan, **places).state != "good" and row.by


def test_without_a_verdict_there_is_no_line_and_numbers_that_are_not_known_have_no_tile():
    assert headline_of({"verdict": verdict_of([CHECK["failed"]])}) == "Failed: coupling energy error 31 %"
    doubtful = Check("saturated", "Joint limits", "doubtful", "at a limit")
    both = verdict_of([doubtful, CHECK["failed"]], ["worst joint 2"])
    assert (both["headline"], both["results"]) == ("Failed: coupling energy error 31 %", "worst joint 2")
    assert checks_line({"verdict": both}) == "0 of 2 checks pass, 1 doubtful, 1 failed"
    assert not [*tiles_of({})] and not headline_of({}) and not state_of({}) and not verdict_text({})
    (tile,) = tiles_of({"key_figures": {"margin": MARGIN | {"value": 0.0}}})
    assert tile.value == "none"
    tiles = tiles_of({"key_figures": {"contact": CONTACT, "saturated": SATURATED, "unstable": UNSTABLE}})
    assert [tile[:3] for tile in tiles] == [
        ("Disturbances grow", "× 1.14", "a step, joint 5, since 0.49 s"),
        ("Time at a limit", "69 %", "torque limit of joint 1, since 0.621 s"),
        ("Contact force", "85.8 N", "at the tool, since 0.53 s"),
    ]


@pytest.mark.parametrize(("sentence", "headline"), [
    ("plant " * 40, "Failed: " + "plant " * 13 + "…"),
    # at the last clause of the second half
    ("gear ratio of joint 1 is 120, not 100: link motion 0.833 times the expected (limit 5 %), 10 others",
     "Failed: gear ratio of joint 1 is 120, not 100: link motion 0.833 times the expected …"),
    ("joint 2: a drive that swings at 0.335 Hz looks like a stiffness per arc minute. Drives have 10 to 100 Hz",
     "Failed: joint 2: a drive that swings at 0.335 Hz looks like a stiffness per arc minute …"),
    # a comma before a number is that of a list
    ("the robot file's links predict the torque better at each of the joints 1, 2, 3, 4, 5, 6, 7, 8",
     "Failed: the robot file's links predict the torque better at each of the joints 1, 2, 3, …"),
    # the cause of a failure, of one or several lines
    (CosimError("ctrl", "doStep", 0.3, "IndexError: list index out of range\n(mypd.py, line 14)").sentence,
     "Failed: run ended at 0.3 s in ctrl: IndexError: list index out of range (mypd.py, line 14)"),
])  # fmt: skip
def test_a_headline_is_cut_between_clauses_or_words(sentence, headline):
    assert verdict_of([Check("end", "Runs to its end", "failed", sentence)])["headline"] == headline


def test_a_headline_ends_with_a_whole_number_wherever_it_is_cut():
    for shift in range(LONGEST // 2):
        text = f"{'x' * shift} link 1000.5 N.m and 2e-13 rad at 120, 100 of 4999 rows; then 12345 more of 67890"
        line = verdict_of([Check("end", "Runs to its end", "failed", text)])["headline"]
        assert len(line) <= LONGEST
        words = {word.strip(",;") for word in text.split()}
        assert {word.strip(",;") for word in line.removesuffix(" …").removeprefix("Failed: ").split()} <= words


def test_the_line_in_the_terminal_has_a_colour_and_key_figures_are_those_of_the_results(planar):
    checks = [CHECK["good"], Check("saturated", "Joint limits", "doubtful", "at a limit")]
    with Console(file=io.StringIO(), width=80, color_system="standard", force_terminal=True) as console:
        with console.capture() as shown:
            console.print(verdict_text({"verdict": verdict_of(checks)}))
    yellow = 33
    assert f"\x1b[{yellow}m! \x1b[0m" in shown.get()
    assert shown.get().endswith("  1 of 2 checks pass, 1 doubtful\n") and "Doubtful: at a limit" in shown.get()
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


@pytest.mark.heavy
def test_another_plant_has_its_own_modes_and_a_tool_error_unless_its_geometry_is_another(planar):
    short: dict[str, Any] = {"stop": 0.05, "out": False, "reference": False}
    rigid = planar[0].summary["key_figures"]["mode"]["value"]
    soft = vdfmu.run("planar_tracking", parameters={f"plant.K_f0[{i}]": 500.0 for i in (1, 2)}, **short)
    figures, robot = soft.summary["key_figures"], vdfmu.load_robot("planar_2dof").with_parameters(K_f0=500.0)
    assert figures["tool_error"]["value"] > 0.0 and figures["mode"]["value"] < rigid
    # among five poses of a motion that has moved the arm by less than 0.01 degrees
    expected = vdfmu.natural_modes(robot, soft["plant.q"][0], motors="held").frequency[0]
    assert figures["mode"]["value"] == pytest.approx(expected, rel=1e-3)
    longer = vdfmu.run("planar_tracking", parameters={"plant.offset[2,1]": 0.6}, **short)
    assert "tool_error" not in longer.summary["key_figures"] and "mode" in longer.summary["key_figures"]


def test_the_page_begins_with_the_verdict_and_the_command_that_makes_the_run_again(planar):
    results, folder = planar
    page = (folder / "report.html").read_text()
    assert f'<p class="verdict good" data-run="0">{headline_of(results.summary)} <small>' in page
    assert f"<title>{page_title('planar_tracking', results.summary)}</title>" in page
    assert page.count('class="tile"') == len(tiles_of(results.summary)) == MOST_TILES
    assert '<details class="checks good" data-run="0"><summary>' in page
    bad = verdict_of([CHECK["failed"]])
    page = report_page([ShownRun("bad", results, results.summary | {"verdict": bad}, folder / "system.ssp")]).decode()
    assert '<p class="verdict failed" data-run="0">Failed: coupling energy error 31 % <small></small></p>' in page
    assert '<details class="checks failed" data-run="0" open>' in page
    assert run_command(planar[0].summary) == "vdfmu run planar_tracking --stop 0.2"
    summary = planar[0].summary | {"scenario": "my own", "parameters": {"controller.K_p[1]": "3"}}
    # a scenario that no file has any more: all its options
    all_options = "--robot planar_2dof --stop 0.2 --step 0.001 --algorithm gauss-seidel --tolerance 1e-07"
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
    facts = run_facts(prepare(path, stop=0.3, algorithm="jacobi", tolerance=1e-5))
    assert run_command(facts) == f"vdfmu run {path} --stop 0.3 --algorithm jacobi --tolerance 1e-05"
    assert run_command(run_facts(prepare(path))) == f"vdfmu run {path}"
    assert run_command(run_facts(prepare(path, robot=robot))) == f"vdfmu run {path} --robot {robot.file}"


def test_a_command_ends_with_the_verdict_and_what_opens_the_page(planar, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    said = ran("report", planar[1], "--no-simulate", "--open")
    page = planar[1] / "report.html"
    assert said.output.splitlines()[-1] == f"Open {page}" and opened == [page.as_uri()]
