"""The verdict on a run as a sentence, its numbers, and the command that makes it again; in terminal and page alike."""

from typing import Any

import pytest
from typer.testing import CliRunner

import vdfmu
from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import load_robot
from vdfmu.base.measure import quantity
from vdfmu.base.toml_file import locate
from vdfmu.cli import runs
from vdfmu.cli.commands import app
from vdfmu.engine.results.verdict import Check, verdict_of
from vdfmu.study.analysis.reach import reach_scenario
from vdfmu.study.report.headline import checks_line, headline, page_title
from vdfmu.study.report.page import report_page, run_command
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.scenario_run import prepare
from vdfmu.study.run.summary import run_facts

FIGURES = {
    "tool_error": {"value": 2.89e-6, "at_s": 4.941},
    "joint_error": {"value": 9.72e-5, "unit": "deg", "joint": 2, "at_s": 5.263},
    "torque": {"value": 35.5, "unit": "N.m", "joint": 2, "at_s": 0.941},
    "margin": {"value": 0.54, "place": "joint 5", "at_s": 1.2},
    "mode": {"value": 13.9, "at_s": 5.0},
}
UNSTABLE = {"value": 1.14, "place": "joint 5", "at_s": 0.49}
GOOD = verdict_of([Check("Sampled loops", True, "stable"), Check("Energy residual of the coupling", True, "small")])
BAD = verdict_of([Check("Sampled loops", True, "stable"), Check("Energy residual of the coupling", False, "31 %")])
BOND = {"residual_energy_abs_j": [0.004, 0.004], "exchanged_energy_j": [16.0, 20.0]}


@pytest.mark.parametrize(
    ("value", "unit", "peak", "text"),
    [
        (2.89e-6, "m", 0, "2.89 µm"),
        (0.00289, "mm", 0, "2.89 µm"),
        (9.72e-5, "deg", 0, "97.2 µdeg"),
        (999.6e-6, "m", 0, "1 mm"),
        (0.763, "deg", 0, "0.763 deg"),
        (0.0999, "deg", 0, "99.9 mdeg"),
        (-1234.5, "N.m", 0, "−1230 N.m"),
        (-12345.0, "N.m", 0, "−12.3 kN.m"),
        (2350.0, "deg", 0, "2350 deg"),
        (1.68e-18, "N.m", 1.0, "0 N.m"),
        (4.56e-13, "rad", 0, "4.56·10⁻¹³ rad"),
        (0.54, "", 0, "0.54"),
        (float("nan"), "m", 0, "–"),
    ],
)
def test_a_number_has_three_digits_and_a_unit_that_fits(value, unit, peak, text):
    assert quantity(value, unit, peak) == text


def test_a_good_run_is_told_by_its_numbers():
    found = headline({"key_figures": FIGURES, "verdict": GOOD, "power_bond": BOND, "step": 1e-3})
    assert found.passed
    assert found.text == (
        "Stable; tool error 2.89 µm at most, at 4.94 s; joint 2 worst, 97.2 µdeg; modulus margin 0.54"
    )
    assert [tile[:4] for tile in found.tiles] == [
        ("Tool error", "2.89 µm", "at 4.94 s", "tool"),
        ("Worst joint", "97.2 µdeg", "joint 2 at 5.26 s", "tracking"),
        ("Peak torque", "35.5 N.m", "joint 2 at 0.941 s", "torque"),
        ("Modulus margin", "0.54", "joint 5 at 1.2 s", "torque"),
        ("Lowest mode", "13.9 Hz", "motors held; loop 1000 Hz", "torsion"),
        ("Energy residual", "0.022 %", "of 36 J exchanged", "facts"),
    ]
    assert [tile.at for tile in found.tiles] == [4.941, 5.263, 0.941, 1.2, 5.0, None]


def test_an_unstable_run_says_since_when_and_where():
    found = headline({"key_figures": FIGURES | {"unstable": UNSTABLE}, "verdict": BAD})
    assert (found.text, found.passed) == ("Unstable since 0.49 s, joint 5", False)
    assert "Disturbances grow" in [tile.name for tile in found.tiles]
    from_the_start = headline({"key_figures": {"unstable": UNSTABLE | {"at_s": 0.0}}, "verdict": BAD})
    assert from_the_start.text == "Unstable from the start, joint 5"


def test_a_check_that_failed_is_quoted():
    found = headline({"key_figures": FIGURES, "verdict": BAD})
    assert (found.text, found.passed) == ("Energy residual of the coupling: 31 %", False)
    assert checks_line({"verdict": BAD}) == "1 of 2 checks pass"


def test_numbers_that_are_not_known_have_no_tile():
    assert headline({}) == ("", True, [])
    assert headline({"verdict": GOOD}) == ("2 of 2 checks pass", True, [])
    without = headline({"key_figures": {"margin": FIGURES["margin"] | {"value": 0.0}}, "verdict": GOOD})
    assert (without.text, without.tiles[0].value) == ("Stable, without a margin at joint 5", "none")


def test_a_torque_with_a_limit_is_a_share_of_it():
    (tile,) = headline({"key_figures": {"torque": FIGURES["torque"] | {"limit": 71.0}}}).tiles
    assert tile[1:3] == ("50 %", "of its limit, 35.5 N.m, joint 2 at 0.941 s")


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("headline")
    return vdfmu.run("planar_tracking", stop=0.2, out=folder, reference=False), folder


def test_key_figures_are_those_of_the_results(planar):
    results, _ = planar
    found = results.summary["key_figures"]
    row = round(found["tool_error"]["at_s"] / results.summary["step"])
    robot = vdfmu.load_robot("planar_2dof")
    ends = [forward_kinematics(robot, results[name][row])[0] for name in ("trajectory.q_d", "plant.q")]
    assert found["tool_error"]["value"] == pytest.approx(((ends[0] - ends[1]) ** 2).sum() ** 0.5, rel=1e-9)
    worst = found["joint_error"]
    assert worst["value"] == max(results.summary["max_position_error_deg"])
    assert worst["joint"] == results.summary["max_position_error_deg"].index(worst["value"]) + 1
    torque = found["torque"]
    peak = abs(robot.ell * results["controller.tau"])
    assert torque["value"] == peak.max() and peak[:, torque["joint"] - 1].max() == peak.max()
    modes = vdfmu.natural_modes(robot, results["plant.q"][0], motors="held")
    # the arm has moved by less than a degree in 0.2 s
    assert found["mode"]["value"] == pytest.approx(modes.frequency[0], rel=0.01)
    assert 0.0 < found["margin"]["value"] <= 1.0


def test_another_plant_has_its_own_modes_and_a_tool_error_unless_its_geometry_is_another(planar):
    short: dict[str, Any] = {"stop": 0.05, "out": False, "reference": False}
    own = planar[0].summary["key_figures"]["mode"]["value"]
    soft = vdfmu.run("planar_tracking", settings={f"plant.K_f0[{i}]": 500.0 for i in (1, 2)}, **short)
    found, robot = soft.summary["key_figures"], vdfmu.load_robot("planar_2dof").with_parameters(K_f0=500.0)
    assert found["tool_error"]["value"] > 0.0 and found["mode"]["value"] < own
    # among five poses of a motion that has moved the arm by less than 0.01 degrees
    expected = vdfmu.natural_modes(robot, soft["plant.q"][0], motors="held").frequency[0]
    assert found["mode"]["value"] == pytest.approx(expected, rel=1e-3)
    longer = vdfmu.run("planar_tracking", settings={"plant.offset[2,1]": 0.6}, **short)
    assert "tool_error" not in longer.summary["key_figures"] and "mode" in longer.summary["key_figures"]


def test_the_page_begins_with_the_verdict(planar):
    results, folder = planar
    page = (folder / "report.html").read_text()
    told = headline(results.summary)
    assert f'<p class="verdict">{told.text}</p>' in page
    assert f"<title>{page_title('planar_tracking', results.summary)}</title>" in page
    assert page.count('class="tile"') == len(told.tiles) == 6
    assert '<details class="checks"><summary>' in page
    failed = ShownRun("bad", results, results.summary | {"verdict": BAD}, folder / "system.ssp")
    page = report_page([failed]).decode()
    assert '<p class="verdict fail">Energy residual of the coupling: 31 %</p>' in page
    assert '<details class="checks" open>' in page


def test_the_command_makes_the_run_again(planar):
    assert run_command(planar[0].summary) == "vdfmu run planar_tracking --stop 0.2"
    own = planar[0].summary | {"scenario": "my own", "settings": {"controller.K_p[1]": "3"}}
    # a scenario that no file has any more: all its options
    all_options = "--robot planar_2dof --stop 0.2 --step 0.001 --master gauss-seidel --tolerance 1e-07"
    assert run_command(own) == f"vdfmu run 'my own' {all_options} --set 'controller.K_p[1]=3'"
    units = own | {"units": {"controller": "pid.py"}}
    assert run_command(units).endswith("--tolerance 1e-07 --unit controller=pid.py --set 'controller.K_p[1]=3'")
    assert run_command(own | {"inputs": ["a.csv"]}) == run_command({"system": "loop"}) == ""


def test_the_command_has_each_option_that_differs(planar, tmp_path):
    shipped = dict(planar[0].summary) | {"backend": "native"}
    assert run_command(shipped | {"stop": 0.1234567891, "backend": "python", "fmi": "3.0"}) == (
        "vdfmu run planar_tracking --stop 0.1234567891 --backend python --fmi 3.0"
    )
    (tmp_path / "bot.toml").write_text(locate("planar_2dof", "robots").read_text())
    robot = load_robot(tmp_path / "bot.toml")
    assert robot.file == str(tmp_path / "bot.toml") and not load_robot("planar_2dof").file
    own = tmp_path / "my.toml"
    text = locate("planar_tracking", "scenarios").read_text()
    own.write_text(text.replace('robot = "planar_2dof"', 'robot = "bot.toml"'))
    facts = run_facts(prepare(own, stop=0.3, master="jacobi", tolerance=1e-5))
    assert run_command(facts) == f"vdfmu run {own} --stop 0.3 --master jacobi --tolerance 1e-05"
    assert run_command(run_facts(prepare(own))) == f"vdfmu run {own}"
    assert run_command(run_facts(prepare(own, robot=robot))) == f"vdfmu run {own} --robot {robot.file}"
    reach = run_facts(prepare(reach_scenario(robot.file)))
    assert run_command(reach).startswith(f"vdfmu run reach --robot {robot.file} --stop ")
    reach = run_facts(prepare(reach_scenario("planar_2dof"), step=0.002))
    assert "vdfmu run reach --robot planar_2dof --stop" in run_command(reach) and "--step 0.002" in run_command(reach)


def test_a_command_ends_with_the_verdict_and_what_opens_the_page(planar, monkeypatch):
    opened = []
    monkeypatch.setattr(runs.webbrowser, "open", lambda address: opened.append(address) or True)
    said = CliRunner().invoke(app, ["report", str(planar[1]), "--no-simulate", "--open"])
    assert said.exit_code == 0, said.output
    page = planar[1] / "report.html"
    assert said.output.splitlines()[-1] == f"Open {page}" and opened == [page.as_uri()]
