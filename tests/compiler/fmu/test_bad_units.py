"""A unit that is wrong gets one message, which says file, line and what was expected."""

import re

import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit.load import load_units

HEAD = """import numpy as np
from vdfmu.unit import JOINTS, Choice, Derivative, Input, Output, Parameter, RobotParameters, Sampled, State, Unit

class Bad(Unit):
"""  # four lines
GOOD = """    u = Input("N", 2, text="force")
    y = Output("N", text="sum")
    def outputs(self):
        self.y = self.u[0] + self.u[1]
"""

CASES = {
    "no variables": ("    pass\n", r"line 4: Bad: a unit needs variables: u = Input\(\.\.\)"),
    "start of another shape": (GOOD + '    g = Parameter("1", 2, start=[1.0, 2.0, 3.0])\n',
                               r"line 9: Bad: g: start: expected numbers of shape \(2,\), got \[1\.0, 2\.0, 3\.0\]"),
    "shape": (GOOD + '    g = Parameter("1", -2)\n', r"line 9: Bad: g: expected a shape of positive integers"),
    "output never set": (GOOD.replace("self.y =", "y ="), r"line 7: outputs\(\) of Bad never sets y"),
    "output without a method": ('    y = Output("N")\n', r"line 5: outputs\(\) of Bad never sets y"),
    "unit of measurement": (GOOD + '    g = Parameter("Nm")\n',
                            r"line 9: Bad: g: expected a unit of measurement such as N\.m.*, got 'Nm'"),
    "name twice": (GOOD + '    u = Parameter("1")\n', r"line 9: Bad: u is declared twice, first in line 5"),
    "method twice": (GOOD + "    def outputs(self):\n        self.y = 0.0\n",
                     r"line 9: Bad: outputs is declared twice, first in line 7"),
    "class twice": (GOOD + "class Bad(Unit):\n" + GOOD, r"line 9: class Bad is declared twice, first in line 4"),
    "name of the robot's parameter": ('    robot = RobotParameters("mass")\n    mass = Parameter("kg")\n',
                                      r"line 6: Bad: mass is there twice: as a variable and in RobotParameters"),
    "NaN at the start": (GOOD.replace("self.u[0] +", "np.log(self.u[0]) *"),
                         r"line 8: outputs\(\) of Bad fails: y is nan at the start values, expected finite numbers"),
    "start not finite": (GOOD + '    g = Parameter("1", start=float("nan"))\n',
                         r"line 9: Bad: g: start: expected finite numbers, got nan"),
    "start out of bounds": (GOOD + '    T = Parameter("s", minimum=1e-6)\n',
                            r"line 9: Bad: T: start: expected at least 1e-06, the minimum, got 0"),
    "raises in a helper": (GOOD.replace("self.u[0] +", "self._half(self.u[0]) +")
                           + "    def _half(self, u):\n        return u / None\n",
                           r"line 10: outputs\(\) of Bad fails: TypeError: unsupported operand"),
    "syntax error": (GOOD + "    def update(self:\n", r"line 9: '\(' was never closed"),
    "raises as it is read": (GOOD + "    g = 1 / 0\n", r"line 9: ZeroDivisionError: division by zero"),
    "state without derivative": ('    x = State("m")\n', r"line 5: Bad: x is a continuous state and needs one "
                                 r"derivative: x_dot = Derivative\(x\)"),
    "derivative never set": ('    x = State("m")\n    x_dot = Derivative(x)\n',
                             r"line 6: derivatives\(\) of Bad never sets x_dot"),
    "no period": ('    y = Sampled("m")\n', r"line 4: Bad: sampled states need a period: period = Parameter"),
    "period that may be 0": ('    y = Sampled("m")\n    period = Parameter("s", start=1e-3)\n',
                             r"line 6: Bad: period: expected a minimum above 0"),
    "name of the time": (GOOD + '    time = Parameter("s")\n', r"line 9: Bad: a variable cannot be called time"),
    "one choice": (GOOD + '    way = Choice("a")\n', r"line 9: Bad: way: expected two or more different choices"),
}  # fmt: skip


@pytest.fixture
def file(tmp_path):
    return tmp_path / "bad.py"


@pytest.mark.parametrize("case", CASES)
def test_the_message_says_where_and_what(planar, file, case):
    body, words = CASES[case]
    file.write_text(HEAD + body, encoding="utf-8")
    with pytest.raises(UnitError) as caught:
        build_fmus(planar, file.parent / "out", units=[file], backend="native", folded=True)
    text = str(caught.value)
    assert text.startswith(str(file)), text
    assert re.search(words, text), text
    assert len(text.splitlines()) == 1
    assert not (file.parent / "out").exists()


def test_a_file_without_a_unit_says_what_is_missing_and_a_base_with_an_underscore_is_none(file):
    file.write_text("x = 1\n")
    with pytest.raises(UnitError, match=re.escape(f"{file} declares no unit. Derive a class from")):
        build_fmus(None, file.parent, units=[file])
    file.write_text("from vdfmu.unit import Unit\n\nclass _Common(Unit):\n    pass\n\nclass Gain(_Common):\n    pass\n")
    assert list(load_units(file)) == ["gain"]


def test_all_that_is_wrong_is_in_one_message_and_what_python_raises_is_reported_at_build(file):
    file.write_text(HEAD + '    a = Parameter("Nm")\n    x = State("m")\n    b = Parameter("1", minimum=1.0)\n')
    with pytest.raises(UnitError) as caught:
        build_fmus(None, file.parent, units=[file])
    assert sorted(re.findall(r"line (\d)", str(caught.value))) == ["5", "6", "7"]
    file.write_text(HEAD + '    backend = "python"\n' + GOOD.replace("self.u[0]", "np.linalg.inv(self.u)"))
    with pytest.raises(UnitError, match=r"line 9: outputs\(\) of Bad fails: LinAlgError"):
        build_fmus(None, file.parent, units=[file])
