"""Robots and scenarios that mean harm: the shipped files with other numbers, texts and lines."""

import dataclasses
import random
import re
from pathlib import Path

import numpy as np

from tests.hostile.table import Corpus
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.files import data_path
from vdfmu.compiler.fmu.build import build_notes
from vdfmu.dynamics import forward_dynamics, inverse_dynamics
from vdfmu.engine.run import simulate
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.check import model_notes
from vdfmu.system.scenario.values import system_values

_NUMBER = re.compile(r"(?<![\w.\"])-?\d+\.?\d*(?:e-?\d+)?(?![\w.\"])")
_TEXT = re.compile(r'(?<== )"[^"\n]*"')
_NUMBERS = (
    "1e308", "-1e308", "1.7976931348623157e308", "5e-324", "-5e-324", "1e-300", "1e-12", "9e-13", "1e12", "1.1e12", "0",
    "-0.0", "nan", "inf", "-inf", "9" * 5000, "0x" + "f" * 5000, "1e400", "true", '"1.0"', "[]", "{}", "[[1.0]]",
    "1979-05-27", "-9.81", "981.0", "1e-3", "1e3", "1e6", "-1",
)  # fmt: skip
_TEXTS = (
    '""', '" "', '"\\u0000"', '"\\u001b[31m"', '"a\\nb"', '"a\\tb"', '"\\u009b2J"', '"\\uFFFE"', '"a" * 3', "3", "[1]",
    f'"{"n" * 300}"', f'"{"n" * 100_000}"', '"../../x"', '"CON"', '"]]>"', '"<&>"', "\"'\"", '"%s%n{0}"', '"é ü 中文"',
    '"lumped"', '"split"', '"prismatic"', '"planar_2dof"', '"missing"', '"/dev/zero"', '"/"', "'''", '"\\uD800"',
)  # fmt: skip
_LINES = (
    "[[joints]]\n", "[joints]\n", "[sources]\n", "joints = []\n", "x = 1\n", "[" * 2000 + "\n",
    "a" * 100_000 + " = 1\n",
    "a = " + "[" * 200 + "]" * 200 + "\n", "\x00\n", "\udcff\n",
    "[payload]\nmass = 1e308\n", "]\n", "gravity = [0, 0, 0]\n",
    '"a\\u001bb" = 1\n',
)  # fmt: skip


def _changed(text: str, dice: random.Random) -> str:
    kind = dice.choice(("number", "number", "number", "scale", "scale", "text", "line", "lines", "cut"))
    if kind in ("number", "scale", "text"):
        places = list((_TEXT if kind == "text" else _NUMBER).finditer(text))
        if not places:
            return text
        place = dice.choice(places)
        new = (
            f"{float(place[0]) * 10.0 ** dice.uniform(-6, 6):.17g}"
            if kind == "scale"
            else dice.choice(_TEXTS if kind == "text" else _NUMBERS)
        )
        return text[: place.start()] + new + text[place.end() :]
    lines = text.splitlines(keepends=True)
    at = dice.randrange(len(lines))
    if kind == "line":
        return "".join([*lines[:at], dice.choice(_LINES), *lines[at:]])
    if kind == "lines":
        return "".join([*lines[:at], *lines[at + dice.randint(1, 3) :]])
    return "".join([*lines, *lines[at:]] if dice.random() < 0.5 else lines[: at + 1])


def _written(kind: str, number: int, folder: Path, names: tuple[str, ...], changes: int) -> Path:
    dice = random.Random(f"{kind} {number}")
    text = (data_path("models") / kind / f"{dice.choice(names)}.toml").read_text(encoding="utf-8")
    for _ in range(dice.randint(0, changes)):
        text = _changed(text, dice)
    path = folder / "file.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    return path


def _finite(label: str, *arrays: np.ndarray) -> None:
    for array in arrays:
        assert np.isfinite(array).all(), f"{label} is not finite"


def robot_file(number: int, folder: Path) -> Robot:
    """Read a robot; one that is taken has finite dynamics."""
    robot = load_robot(_written("robots", number, folder, ("planar_2dof", "manipulator_6dof"), 3))
    _finite("a field", *(getattr(robot, name) for name in PARAMETERS))
    build_notes(robot)
    q = np.linspace(-1.0, 1.0, robot.n)
    tau = inverse_dynamics(robot, q, q, q)
    _finite("tau", tau)
    _finite("q_ddot", forward_dynamics(robot, q, q, tau))
    return robot


def scenario_file(number: int, folder: Path) -> Scenario:
    """Read a scenario; one that is taken runs some steps to finite signals."""
    names = ("planar_tracking", "planar_tracking", "planar_tracking", "tracking")
    scenario = load_scenario(_written("scenarios", number, folder, names, 3))
    model_notes(scenario)
    if scenario.robot.name == "planar_2dof":
        _run(scenario, folder)
    return scenario


def robot_run(number: int, folder: Path) -> None:
    """Build the FMUs of a robot with other numbers, and run some steps to finite signals."""
    dice = random.Random(f"run {number}")
    text = (data_path("models") / "robots" / "planar_2dof.toml").read_text(encoding="utf-8")
    place = dice.choice(list(_NUMBER.finditer(text, text.index("gravity ="))))
    new = f"{(float(place[0]) or 1.0) * 10.0 ** dice.uniform(-9, 9):.17g}"
    path = folder / "robot.toml"
    path.write_text(text[: place.start()] + new + text[place.end() :], encoding="utf-8")
    _run(load_scenario("planar_tracking", str(path)), folder)


def _run(scenario: Scenario, folder: Path) -> None:
    scenario = dataclasses.replace(scenario, stop=5 * scenario.step)
    package = write_ssp(scenario, cached_fmus(scenario, folder), folder / "s.ssp", system_values(scenario))
    results = simulate(
        package, start=0.0, stop=scenario.stop, step=scenario.step, algorithm=scenario.algorithm,
        adaptive=scenario.adaptive,
    )  # fmt: skip
    _finite("a signal", *(results[name] for name in results.names))


CORPORA = [
    Corpus("robots, valid and changed", 1000, robot_file, quick=40, seconds=20.0),
    Corpus("scenarios, valid and changed, five steps", 500, scenario_file, quick=15, seconds=60.0),
    Corpus("robots with other numbers, built, five steps", 60, robot_run, quick=2, seconds=120.0),
]
