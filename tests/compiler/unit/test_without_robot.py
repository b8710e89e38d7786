"""A scenario whose components take no robot: a DC motor and a controller of its speed."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import vdfmu
from tests.compiler.unit.motor import SCENARIO, SYSTEM, write_motor
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.cli.commands import app
from vdfmu.engine.run import Results
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.check import model_notes

R, L, K, J, B, K_P, K_I = 1.0, 0.01, 0.05, 1e-4, 1e-4, 0.05, 1.0
LOOP = np.array([[0.0, 0.0, -1.0], [K_I / L, -R / L, -(K + K_P) / L], [0.0, K / J, -B / J]])  # of e, i, w
ARM = """
extends = "system"
name = "own_robots"
[components]
""" + "".join(
    f'{name} = {{ unit = "{name}", robot = "ur5e_6dof" }}\n'
    for name in ("trajectory", "feedforward", "controller", "plant")
)
REACH = """
name = "own_robots"
system = "own_robots.toml"
stop = 0.02
step = 0.001
[trajectory]
q_end = 0.1
T = 0.5
[controller]
K_p = 300.0
K_v = 20.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("motor")
    write_motor(place)
    for name, text in {"own_robots.toml": ARM, "reach.toml": REACH}.items():
        (place / name).write_text(text)
    return place


@pytest.fixture
def inside(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def command(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit | UsageError | ModelError), done.output
    return done


@pytest.fixture(scope="module")
def ran(folder):
    done = command("run", folder / "motor.toml", "--out", folder / "run", "--simulate")
    assert done.exit_code == 0, done.output
    return Results.read(folder / "run" / "results.csv"), json.loads((folder / "run" / "summary.json").read_text())


@pytest.mark.heavy
@pytest.mark.parametrize("words", [
    "build motor.toml --out fmus", "build motor.toml --out fmus_python --backend python",
    "ssp motor.toml --reference", "check motor.toml", "check drive.toml",
    "run motor.toml --fmi 3.0 --algorithm iterative --adaptive 1e-4 --out adaptive",
])  # fmt: skip
def test_commands_work(inside, words):
    done = command(*words.split())
    assert done.exit_code == 0, done.output
    assert "obot" not in done.output


@pytest.mark.heavy
def test_the_linearization_is_that_of_the_matrices_and_a_margin_needs_no_torque(inside):
    system = vdfmu.linearize("motor.toml", 0.0)
    assert system.states == ("controller.e", "motor.i", "motor.w")
    np.testing.assert_allclose(system.A, LOOP, rtol=1e-12, atol=1e-12)  # products of two or three numbers, by rounding
    assert vdfmu.load("motor.toml").margins(at=[0.0]).names == ("controller.w",)  # the loop opened where it is cut


TAKES_ONE = "uses a robot"


@pytest.mark.parametrize(("words", "message"), [
    ("run motor.toml --robot planar_2dof", f"{TAKES_ONE}, got planar_2dof"),
    *([("linear motor.toml --modes", "expected a system with a component trajectory")] * ("linear" in app.commands)),
    ("scenario motion motor.toml", "expected a robot, named in the file or by --robot"),
    ("run motor.toml --unit controller=controller", "robot: expected one for controller, got none"),
    ("run motor.toml --set robot.mass=3", "no component has a parameter mass of the robot"),
    ("run motor.toml --set motor.payload_mass=3", "has no payload_mass"),
    ("sweep run motor.toml --vary robot=planar_2dof --measure top=peak(motor.w)", TAKES_ONE),
])  # fmt: skip
def test_refusals_say_what_is_missing(inside, words, message):
    done = command(*words.split())
    assert done.exit_code != 0
    assert message in " ".join(f"{done.output} {done.exception}".split())


def test_keys_of_a_robot_are_refused_and_what_needs_one_is_named(inside):
    for extra in (
        'friction = "smooth"', "payload = { mass = 1.0 }", 'motion = { kind = "circle" }', "plant_factors = {}",
        'paper = { source = "Table 4" }',
    ):  # fmt: skip
        (inside / "extra.toml").write_text(f"{extra}\n{SCENARIO}")
        key = extra.partition(" ")[0]
        with pytest.raises(
            ModelError, match=rf"extra\.toml: {key}: expected a scenario with a robot.* leave {key} out"
        ):
            load_scenario("extra.toml")
    (inside / "arm.toml").write_text(SCENARIO.replace('system = "drive.toml"\n', "").partition("[controller]")[0])
    expected = r"arm\.toml: robot: expected one for trajectory, feedforward, controller, plant, got none\. Name one"
    with pytest.raises(ModelError, match=expected) as caught:
        load_scenario("arm.toml")
    assert len(caught.value.problems) == 1
    assert load_scenario("arm.toml", "planar_2dof").arm.name == "planar_2dof"  # which the option may be


def test_a_robot_that_nothing_takes_is_noted(inside):
    scenario = load_scenario("motor.toml")
    assert scenario.robot is None
    assert model_notes(scenario) == []
    with pytest.raises(UsageError, match=r"scenario motor has no robot\. Name one in its file"):
        _ = scenario.arm
    (inside / "named.toml").write_text(f'robot = "planar_2dof"\n{SCENARIO}')
    (note,) = model_notes(load_scenario("named.toml"))
    assert note.startswith("robot: no component uses it.")


@pytest.mark.heavy
def test_components_with_robots_of_their_own_need_no_other(inside):
    (inside / "both.toml").write_text(f'robot = "ur5e_6dof"\n{REACH}')
    alone = vdfmu.run("reach.toml", out=inside / "alone", pictures=["png"])
    both = vdfmu.run("both.toml", out=False, reference=False)
    assert alone.names == both.names
    for name in alone.names:
        np.testing.assert_array_equal(alone[name], both[name])
    assert "robot" not in alone.summary
    assert (inside / "alone" / "figure_tracking.png").is_file()


def test_end_stops_are_those_of_the_component(inside):
    (inside / "beyond.toml").write_text(REACH.replace("q_end = 0.1", "q_end = 7.0"))
    words = r"trajectory\.q_end\[1\]: expected a position of joint 1 between its end stops"
    with pytest.raises(ModelError, match=words):
        load_scenario("beyond.toml")


@pytest.mark.heavy
def test_fmus_of_any_tool_need_no_robot(inside, ran):
    fmus = build_fmus(None, inside / "any", units=["motor.py:DCMotor", "motor.py:SpeedPI"])
    assert len(fmus) == 2
    wired = SYSTEM.replace("motor.py:SpeedPI", "any/SpeedPI.fmu").replace("motor.py:DCMotor", "any/DCMotor.fmu")
    (inside / "any.toml").write_text(wired)
    (inside / "fmus.toml").write_text(SCENARIO.replace("drive.toml", "any.toml"))
    results = vdfmu.run("fmus.toml", out=False)
    np.testing.assert_array_equal(results["motor.w"], ran[0]["motor.w"])  # as CSV has all digits
    assert "an FMU has no equations" in results.summary["no_reference"]
