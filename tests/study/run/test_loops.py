"""A run that solves an algebraic loop, of which there is no reference."""

import pytest

import vdfmu

UNIT = '''
from vdfmu.unit import Input, Output, Unit


class Half(Unit):
    """Half of the input, and one."""

    u = Input("1", text="in")
    y = Output("1", text="out")

    def outputs(self):
        self.y = 0.5 * self.u + 1.0
'''
SYSTEM = """
name = "loop"
description = "Two units that read each other"
components = { a = "half.py", b = "half.py" }
connections = { "a.y" = ["b.u"], "b.y" = ["a.u"] }
"""
SCENARIO = """
name = "loop"
system = "system.toml"
robot = "planar_2dof"
stop = 0.5
step = 0.01
algorithm = "jacobi"
"""


@pytest.mark.heavy
def test_the_results_of_a_loop_are_kept_and_say_why_there_is_no_reference(tmp_path):
    for name, text in {"half.py": UNIT, "system.toml": SYSTEM, "scenario.toml": SCENARIO}.items():
        (tmp_path / name).write_text(text)
    results = vdfmu.run(tmp_path / "scenario.toml", out=tmp_path / "out", backend="python")
    assert "algebraic loop" in results.summary["no_reference"] and results.summary["reference"] == {}
    # y = 2 solves the loop; each step halves the first difference of at most 2
    assert abs(results["a.y"][-1] - 2.0) < 2.0 * 0.5**40
    assert (tmp_path / "out" / "results.csv").is_file()
