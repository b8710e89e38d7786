"""Units of one name in several files, and files that change: each component is what its file says now."""

import sys

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.fmu.content import Content

GAIN = '''
from vdfmu.unit import Input, Output, Parameter, Unit


class Gain(Unit):
    """Gain."""

    u = Input("1", text="in")
    k = Parameter("1", text="factor", start={start})
    y = Output("1", text="out")

    def outputs(self):
        self.y = self.k * self.u
'''
HELPED = '''
from factor import FACTOR
from vdfmu.unit import Input, Output, Unit


class Helped(Unit):
    """Gain of a module beside it."""

    files = ("factor.py",)
    u = Input("1", text="in")
    y = Output("1", text="out")

    def outputs(self):
        self.y = FACTOR * self.u
'''
SYSTEM = """
name = "pair"
description = "Two units, one after the other"
components = {{ a = "{a}", b = "{b}" }}
connections = {{ "a.y" = ["b.u"] }}
"""
SCENARIO = """
name = "pair"
system = "system.toml"
robot = "planar_2dof"
stop = 0.02
step = 0.01
a = { u = 1.0 }
"""


def last(folder, a, b, backend="python", **options):
    """Last outputs of two units in a row, of which the first is given 1."""
    (folder / "system.toml").write_text(SYSTEM.format(a=a, b=b))
    (folder / "scenario.toml").write_text(SCENARIO)
    results = vdfmu.run(folder / "scenario.toml", out=folder / "out", backend=backend, **options)
    return results["a.y"][-1], results["b.y"][-1]


@pytest.mark.heavy
def test_units_and_modules_of_one_name_are_two_and_a_change_of_a_start_value_is_built(tmp_path):
    for name, start in (("one", 3.0), ("two", 7.0)):
        (tmp_path / f"{name}.py").write_text(GAIN.format(start=start))
    assert last(tmp_path, "one.py", "two.py") == (3.0, 21.0)
    build_fmus(None, tmp_path / "fmus", units=[tmp_path / "one.py"], backend="python")
    assert last(tmp_path, "two.py", "fmus/Gain.fmu") == (7.0, 21.0)
    for folder, factor in (("p", 3.0), ("q", 7.0)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "helped.py").write_text(HELPED)
        (tmp_path / folder / "factor.py").write_text(f"FACTOR = {factor}\n")
    assert last(tmp_path, "p/helped.py", "q/helped.py", reference=False) == (3.0, 21.0)
    (tmp_path / "one.py").write_text(GAIN.format(start=3.0))
    before = Content(find_unit(tmp_path / "one.py"), None, {}).guid
    assert last(tmp_path, "one.py", "one.py", reference=False) == (3.0, 9.0)
    (tmp_path / "one.py").write_text(GAIN.format(start=8.0))
    assert Content(find_unit(tmp_path / "one.py"), None, {}).guid != before
    assert last(tmp_path, "one.py", "one.py", reference=False) == (8.0, 64.0)


HELD = '''
from vdfmu.unit import Input, Parameter, Sampled, Unit


class Held(Unit):
    """Sample and hold."""

    u = Input("1", text="in")
    period = Parameter("s", text="period", start=0.01, minimum=1e-6)
    s = Sampled("1", text="sample")

    def update(self):
        self.s = self.u
'''


@pytest.fixture
def held(tmp_path):
    (tmp_path / "held.py").write_text(HELD)
    return find_unit(tmp_path / "held.py")


@pytest.mark.parametrize("step", [0.001, 0.02, 0.1, 0.25])
def test_samples_between_rows_see_the_input_of_their_time(held, step):
    solution = held().simulate({"u": lambda t: t}, stop=0.5, step=step)
    np.testing.assert_allclose(solution["s"][-1], 0.49, rtol=0, atol=1e-12)  # rounding of a time below 1 s


def test_what_no_fmu_would_take_is_refused(held):
    for wrong in ({"stop": -1.0}, {"stop": 0.5, "step": 0.3}, {"stop": np.nan}, {"stop": 1.0, "step": 0.0}):
        with pytest.raises(UsageError, match="stop|step"):
            held().simulate(**wrong)
    with pytest.raises(UsageError, match="period"):
        held(period=-0.1).simulate(stop=0.1)
    with pytest.raises(UsageError, match="input u: expected 1 numbers, got 2"):
        held().simulate({"u": [1.0, 2.0]}, stop=0.1)


NOTED = """
from pathlib import Path

from vdfmu.compiler.scalar.symbol import Symbol


def note(word):
    with Path(__file__).with_name("log.txt").open("a") as log:
        log.write(word + " ")


note("run")
""" + GAIN.replace("(self):", "(self):\n        if isinstance(self.u, Symbol):\n            note('trace')")


@pytest.mark.heavy
def test_a_run_executes_a_file_once_and_traces_a_unit_once(tmp_path):
    """Both components, their values, FMUs, descriptions and references come from one execution and one trace."""
    (tmp_path / "noted.py").write_text(NOTED.format(start=3.0))
    assert last(tmp_path, "noted.py", "noted.py", backend="native") == (3.0, 9.0)
    assert (tmp_path / "log.txt").read_text().split() == ["run", "trace"]
    (tmp_path / "noted.py").write_text(NOTED.format(start=5.0))
    assert last(tmp_path, "noted.py", "noted.py", backend="native") == (5.0, 25.0)
    assert (tmp_path / "log.txt").read_text().split() == 2 * ["run", "trace"]


def test_a_change_within_a_second_and_of_no_size_is_seen(tmp_path, monkeypatch):
    """Python itself takes the bytecode that it keeps for that of the new source."""
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    (tmp_path / "helped.py").write_text(HELPED)
    for factor in (3.0, 8.0, 5.0):
        (tmp_path / "factor.py").write_text(f"FACTOR = {factor}\n")
        helped = find_unit(tmp_path / "helped.py")(u=1.0)
        helped.outputs()
        assert helped.y == factor
    assert sorted(file.name for file in tmp_path.iterdir()) == ["factor.py", "helped.py"]


@pytest.mark.parametrize(
    ("text", "words"), [("import sys\n\nsys.exit()\n", "SystemExit"), ("import beside\n\n1 / 0\n", "ZeroDivisionError")]
)
def test_a_file_that_ends_python_or_fails_has_no_unit_and_leaves_no_module(tmp_path, text, words):
    (tmp_path / "beside.py").write_text("VALUE = 1\n")
    (tmp_path / "failing.py").write_text(text)
    before = set(sys.modules)
    with pytest.raises(UnitError, match=f"failing.py, line 3: {words}"):
        find_unit(tmp_path / "failing.py")
    assert set(sys.modules) == before
