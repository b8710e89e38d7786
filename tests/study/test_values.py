"""The same value is accepted or refused with the same sentence, wherever it is given."""

import json
import math
import re
import zipfile
from decimal import Decimal

import fmpy
import numpy as np
import pytest

import vdfmu
from tests.engine import texts
from tests.engine.files import zipped
from tests.warm import command
from vdfmu.base.errors import VdfmuError
from vdfmu.base.option import read_settings
from vdfmu.compiler.unit.load import load_units
from vdfmu.engine.run import simulate
from vdfmu.system.scenario.scenario_file import load_scenario
from vdfmu.system.scenario.values import start_values, system_values

UNIT = '''
"""A unit with a parameter of each type."""
from vdfmu.unit import Choice, Output, Parameter, Switch, Unit


class Typed(Unit):
    """A gain."""

    k = Parameter("m", start=1.0, minimum=0.0, text="a length")
    mode = Choice("off", "on", text="whether")
    form = Choice("round", "square", text="shape")
    flag = Switch(False, text="a flag")
    y = Output("m", text="the length")

    def outputs(self) -> None:
        self.y = self.k
'''
GAIN = '''
from vdfmu.unit import Input, Output, Unit


class Gain(Unit):
    """A gain."""

    u = Input("1")
    y = Output("1")

    def outputs(self) -> None:
        self.y = 2.0 * self.u
'''
SYSTEM = 'name = "mine"\n[components]\na = "typed.py"\n'
SCENARIO = 'name = "mine"\nsystem = "mine.toml"\nstop = 0.02\nstep = 0.01\n[a]\n'
VALUES = [
    ("k", 2.5), ("k", 2), ("k", "2.5"), ("k", np.float32(0.5)), ("k", Decimal("0.5")), ("k", True), ("k", "2,5"),
    ("k", math.nan), ("k", "nan"), ("k", math.inf), ("k", -1.0), ("k", "x"), ("k", None), ("k", 10**400),
    ("mode", 1), ("mode", 1.0), ("mode", "1"), ("mode", "on"), ("mode", np.int64(1)), ("mode", 2), ("mode", 0.5),
    ("mode", "an"), ("mode", True), ("mode", math.nan),
    ("flag", True), ("flag", "true"), ("flag", 1), ("flag", 0), ("flag", "yes"), ("flag", 2), ("flag", 0.5),
]  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("values")
    (folder / "typed.py").write_text(UNIT)
    (folder / "mine.toml").write_text(SYSTEM)
    (folder / "run.toml").write_text(SCENARIO)
    vdfmu.build(folder / "typed.py", folder / "a.fmu")
    return folder


@pytest.fixture(scope="module")
def simulator(place):
    system = vdfmu.connect({"a": place / "a.fmu"}, stop=0.02, step=0.01)
    with system.instance() as made:
        yield made


def verdict(call):
    """Return None if a call succeeds, else what its error says from "expected" on."""
    try:
        call()
    except VdfmuError as error:
        (sentence,) = re.findall(r"expected .*", str(error))
        return sentence.rstrip(".")
    return None


def _toml(place, name, value):
    path = place / "given.toml"
    text = str(value).lower() if isinstance(value, bool | float) else json.dumps(value)
    path.write_text(SCENARIO + f"{name} = {text}\n")
    scenario = load_scenario(path)
    system_values(scenario)


def _ssv(place, name, value):
    kind = {bool: "Boolean", int: "Integer", float: "Real"}[type(value)]
    text = str(value).lower().replace("nan", "NaN").replace("inf", "INF")
    bound = texts.values(texts.parameter(name, text, kind))
    path = place / "given.ssp"
    package = texts.ssd(texts.elements(texts.component("a", inner=bound)))
    path.write_bytes(zipped({"SystemStructure.ssd": package, "a.fmu": (place / "a.fmu").read_bytes()}))
    simulate(path, stop=0.02, step=0.01)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_fmu_of_a_unit_with_two_choices_is_valid(place, version):
    path = vdfmu.build(place / "typed.py", place / f"{version}.fmu", fmi=version)
    fmpy.read_model_description(str(path), validate=True)


@pytest.mark.few(4)
@pytest.mark.parametrize(("name", "value"), VALUES)
def test_each_entry_gives_the_same_verdict(place, simulator, name, value):
    unit = load_units(place / "typed.py")["typed"]
    full = f"a.{name}"
    entries = {
        "connect": lambda: vdfmu.connect({"a": place / "a.fmu"}, parameters={full: value}),
        "Simulator.run": lambda: simulator.run(parameters={full: value}),
        "Simulator.reset": lambda: simulator.reset(parameters={full: value}),
        "build": lambda: vdfmu.build(place / "typed.py", place / "b.fmu", parameters={name: value}),
        "build --set": lambda: start_values(unit, None, {name: value}),
        "scenario": lambda: system_values(load_scenario(place / "run.toml"), {full: value}),
    }
    if isinstance(value, str):
        settings = read_settings([f"{full}={value}"])
        entries["--set"] = lambda: simulator.run(parameters=settings)
    if type(value) in (bool, int, float, str) and value != 10**400:
        entries["TOML"] = lambda: _toml(place, name, value)
    if type(value) in (bool, int, float) and value != 10**400:
        entries["SSV"] = lambda: _ssv(place, name, value)
    verdicts = {entry: verdict(call) for entry, call in entries.items()}
    assert len(set(verdicts.values())) == 1, verdicts


def test_a_name_of_a_choice_is_written_and_run(place, tmp_path):
    system = vdfmu.connect({"a": place / "a.fmu"}, parameters={"a.mode": "on", "a.flag": "True", "a.k": "3"})
    with zipfile.ZipFile(system.write(tmp_path / "a.ssp")) as package:
        text = package.read("SystemStructure.ssd").decode()
    assert '<ssv:Integer value="1"/>' in text and '<ssv:Boolean value="true"/>' in text
    assert '<ssv:Real value="3.0"/>' in text
    assert "FixedStepAlgorithm" in text  # without it libcosim refuses the package
    assert system.run(parameters={"a.mode": "off"})["a.y"][-1] == 3.0


def test_an_input_that_is_given_a_value_has_no_note_on_its_start_value(tmp_path):
    (tmp_path / "gain.py").write_text(GAIN)
    fmu = vdfmu.build(tmp_path / "gain.py", tmp_path / "gain.fmu")
    system = vdfmu.connect({"a": fmu}, stop=0.02, step=0.01)
    note = "a.u: input is not connected and keeps its start value"
    assert note in system.run().summary["notes"]
    assert note not in system.run(parameters={"a.u": 2.0}).summary["notes"]
    package = system.write(tmp_path / "a.ssp")
    done = command("run", package, "--set", "a.u=2", "--judge", "1", "--out", tmp_path / "out")
    assert "keeps its start value" not in done.stdout + done.stderr, done.stderr
