"""What a unit requires of its parameters is refused in the same words before a run, by Python and by both FMUs."""

import fmpy
import numpy as np
import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.evaluate import traced_requirements
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values
from vdfmu.unit import Choice, Input, Output, Parameter, Unit

WORDS = "normal[1]: expected a direction, got normal[1] = 0, normal[2] = 0, normal[3] = 0."


def test_a_direction_of_no_length_is_refused_from_python_and_in_a_scenario_before_its_run():
    for unit, group in (("wall", "normal"), ("screw", "axis")):
        with pytest.raises(UsageError) as caught:
            find_unit(unit)(**{group: np.zeros(3)}).simulate(stop=0.1, step=0.01)
        assert str(caught.value) == f"{unit}: {WORDS.replace('normal', group)}"
    with pytest.raises(UsageError) as caught:
        system_values(load_scenario("wall"), {"wall.normal": 0.0})
    assert str(caught.value) == f"wall.{WORDS}"


@pytest.mark.parametrize("backend", ["native", "python"])
def test_fmus_of_both_kinds_refuse_the_initialization(backend, tmp_path, caplog):
    path = build_fmus(None, tmp_path, units=[find_unit("wall")], backend=backend)["wall"]
    said: list[str] = []

    def log(*arguments):
        said.append(arguments[-1] if isinstance(arguments[-1], str) else arguments[-1].decode())

    with pytest.raises(Exception, match="nitializ"):
        fmpy.simulate_fmu(str(path), stop_time=0.01, start_values={"normal[1]": 0.0}, logger=log)
    said += caplog.messages  # of Python FMUs
    assert any(line.endswith(f"failed: {WORDS}") for line in said), said
    assert len(fmpy.simulate_fmu(str(path), stop_time=0.01, start_values={"normal[1]": 1e-9})) > 1


def test_start_values_that_are_not_met_are_refused_by_the_build(tmp_path):
    values = {"wall": {"normal[1]": 0.0}}
    with pytest.raises(UsageError, match=r"start values of wall: normal\[1\]: expected a direction"):
        build_fmus(None, tmp_path, units=[find_unit("wall")], parameters=values, backend="python")


class Early(Unit):
    """A unit whose requirements read what has no value yet."""

    u = Input("1", text="input")
    mode = Choice("a", "b", text="choice")
    k = Parameter("N/m", text="parameter", start=1.0)
    y = Output("1", text="output")

    def outputs(self):
        self.y = self.u


@pytest.mark.parametrize("name", ["u", "mode"])
def test_what_is_no_parameter_is_not_required(name):
    unit = type("Early", (Early,), {"requirements": lambda self: {"k": ("more", getattr(self, name))}})
    with pytest.raises(UnitError, match=f"requirements.* {name} is not a parameter with numbers"):
        traced_requirements(Interface(unit, None))


@pytest.mark.parametrize(("returned", "got"), [
    (None, "None"), (["k"], r"\['k'\]"), ({"stiffness": ("k > 0", 1.0)}, "'stiffness', which is not a parameter"),
    ({"y": ("k > 0", 1.0)}, "'y', which is not a parameter"), ({"k": 1.0}, "'k': 1.0"),
    ({"k": ("k > 0", np.ones(3))}, r"'k': \('k > 0', array"),
])  # fmt: skip
def test_requirements_of_another_form_are_told_with_what_is_expected(returned, got):
    unit = type("Early", (Early,), {"requirements": lambda self: returned})
    words = f"requirements.. of Early: expected a parameter's name to its condition and one number.*got {got}"
    with pytest.raises(UnitError, match=words):
        traced_requirements(Interface(unit, None))
    with pytest.raises(UnitError, match=words):
        unit().simulate(stop=0.1)
