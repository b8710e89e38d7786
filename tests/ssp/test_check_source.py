"""`vdfmu check` of robot, scenario and system files and of units of one's own."""

from pathlib import Path

import pytest

from vdfmu.data import data_path
from vdfmu.model import load_robot
from vdfmu.ssp.check import check_source

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "units"
SCENARIO = 'name = "x"\nkind = "cosimulation"\nrobot = "planar_2dof"\nstop = 1.0\nstep = 0.001\n'
SYSTEM = 'name = "x"\ndescription = "x"\n[units]\nplant = "plant"\ncontroller = "controller"\n[connections]\n'
UNIT = (
    "from vdfmu.unit import Input, Output, Unit\n\n\nclass Gain(Unit):\n    u = Input()\n    y = Output()\n\n"
)


@pytest.fixture(scope="module")
def planar():
    return load_robot("planar_2dof")


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        (data_path("models") / "robots" / "planar_2dof.toml", "robot"),
        (data_path("models") / "scenarios" / "tracking.toml", "scenario"),
        (data_path("ssp") / "estimator.toml", "system"),
        (EXAMPLES / "scenario.toml", "scenario"),
        (EXAMPLES / "arm.toml", "system"),
        (EXAMPLES / "wall.py", "unit"),
    ],
)
def test_what_is_right_has_no_problems(planar, path, kind):
    assert check_source(path, planar) == (kind, [], [])


@pytest.mark.parametrize(
    ("name", "text", "kind", "problem"),
    [
        ("x.toml", "name = 3", "scenario", "expected a string"),
        ("x.toml", "a = [", "TOML", "expected TOML, got a syntax error"),
        (
            "x.toml",
            SCENARIO + "[controller]\nK_q = 1\n",
            "scenario",
            "x.toml: controller.K_q: controller has no K_q",
        ),
        ("x.toml", 'extends = "system"\n[units]\nplant = "plnt"\n', "system", "There is no unit 'plnt'"),
        (
            "x.toml",
            'extends = "system"\nname = "x"\n[connections]\n"plant.qq" = ["controller.q"]\n',
            "system",
            "connections: plant.qq: expected an output of plant, got 'qq'. Did you mean",
        ),
        (
            "x.toml",
            SYSTEM + '"plant.E_kin" = ["controller.q"]\n',
            "system",
            "x.toml: connections: plant.E_kin -> controller.q: expected signals of one shape, got () and (2,).",
        ),
        (
            "x.toml",
            SYSTEM + '"plant.q" = ["plant.tau"]\n',
            "system",
            "x.toml: connections: plant.q -> plant.tau: expected one unit of measurement, got rad and N.m.",
        ),
        (
            "x.toml",
            SYSTEM + '"plant.tau_s" = ["plant.tau"]\n"controller.tau" = ["plant.tau"]\n',
            "system",
            "x.toml: connections: plant.tau: expected one output that feeds it, got plant.tau_s and controller.tau.",
        ),
        (
            "x.toml",
            SYSTEM + '"plant.q" = ["controller.q", "controller.q"]\n',
            "system",
            "x.toml: connections: controller.q: expected one output that feeds it, got plant.q and plant.q.",
        ),
        ("x.py", UNIT + "    def outputs(self) -> None:\n        self.y = self.v\n", "unit", "x.py, line 9"),
        ("x.py", UNIT, "unit", "y"),
    ],
)
def test_what_is_wrong_is_named(planar, tmp_path, name, text, kind, problem):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    found, problems, _ = check_source(path, planar)
    assert found == kind
    assert any(problem in line for line in problems), problems
