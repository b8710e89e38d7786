"""`vdfmu check` of robot, scenario and system files and of units of one's own."""

import os

import pytest

from vdfmu.system.inspect_source import inspect_source

SCENARIO = 'name = "x"\nrobot = "planar_2dof"\nstop = 1.0\nstep = 0.001\n'
SYSTEM = 'name = "x"\ndescription = "x"\n[components]\nplant = "plant"\ncontroller = "controller"\n[connections]\n'
UNIT = "from vdfmu.unit import Input, Output, Unit\n\n\nclass Gain(Unit):\n    u = Input()\n    y = Output()\n\n"


@pytest.mark.parametrize(("name", "text", "kind", "problem"), [
    ("x.toml", "name = 3", "scenario", "expected a string"),
    ("x.toml", "a = [", "TOML", "expected TOML, got a syntax error"),
    ("x.toml", SCENARIO + "[controller]\nK_q = 1\n", "scenario", "x.toml: controller.K_q: controller has no K_q"),
    ("x.toml", 'extends = "system"\n[components]\nplant = "plnt"\n', "system", "There is no unit 'plnt'"),
    ("x.toml", 'extends = "system"\nname = "x"\n[connections]\n"plant.qq" = ["controller.q"]\n', "system",
     "connections: plant.qq: expected an output of plant, got 'qq'. Did you mean"),
    ("x.toml", SYSTEM + '"plant.E_kin" = ["controller.q"]\n', "system",
     "x.toml: connections: plant.E_kin -> controller.q: expected signals of the same shape, got () and (2,)."),
    ("x.toml", SYSTEM + '"plant.q" = ["plant.tau"]\n', "system",
     "x.toml: connections: plant.q -> plant.tau: expected one unit of measurement, got rad and N.m."),
    ("x.toml", SYSTEM + '"plant.tau_s" = ["plant.tau"]\n"controller.tau" = ["plant.tau"]\n', "system",
     "x.toml: connections: plant.tau: expected one connected output, got plant.tau_s and controller.tau."),
    ("x.toml", SYSTEM + '"plant.q" = ["controller.q", "controller.q"]\n', "system",
     "x.toml: connections: controller.q: expected one connected output, got plant.q and plant.q."),
    ("x.py", UNIT + "    def outputs(self) -> None:\n        self.y = self.v\n", "unit", "x.py, line 9"),
    ("x.toml", SCENARIO + '[joints]\ndrive = "none.py"\n', "scenario", "none.py"),  # the joints of a robot are a list
    ("x.py", UNIT, "unit", "y"),
])  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, name, text, kind, problem):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    report = inspect_source(path, "planar_2dof")
    assert report.kind == kind
    assert any(problem in line for line in report.problems), report.problems


@pytest.mark.heavy
def test_a_file_that_ends_its_process_or_is_no_python_is_a_problem(tmp_path):
    killed = "signal 9" if os.name == "posix" else "exit code 9"
    for end, how in (("os._exit(3)", "exit code 3"), ("os.kill(os.getpid(), 9)", killed)):
        (tmp_path / "x.py").write_text(f"import os\n{end}\n")
        (problem,) = inspect_source(tmp_path / "x.py", "planar_2dof").problems
        assert (problem.rule.number, f"crashed ({how}) in the check of x.py" in problem) == ("RUN002", True)
    for text, line in (("class :\n", 1), ("a = 1\n\nb = (\n", 3), ("\0", 0)):
        (tmp_path / "x.py").write_text(text)
        for run in (True, False):
            report = inspect_source(tmp_path / "x.py", "planar_2dof", run=run)
            assert not report.ran
            assert [(p.rule.number, p.line) for p in report.problems] == [("SRC001", line)], report
