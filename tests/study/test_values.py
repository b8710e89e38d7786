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
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.run import simulate
from vdfmu.study.report.shown_run import read_run
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


CLOCK = '''
from vdfmu.unit import Choice, Output, Unit


class Clock(Unit):
    """A clock that can be fast."""

    mode = Choice("right", "fast", "stopped")
    y = Output("s")

    def outputs(self) -> None:
        if self.mode == "right":
            self.y = self.t
        elif self.mode == "fast":
            self.y = 2.0 * self.t
        else:
            self.y = 0.0 * self.t
'''


@pytest.mark.heavy
@pytest.mark.parametrize(("version", "backend"), [("2.0", "native"), ("3.0", "native"), ("2.0", "python")])
def test_a_choice_is_set_by_its_name_in_every_fmu(tmp_path, version, backend):
    (tmp_path / "clock.py").write_text(CLOCK)
    fmu = vdfmu.build(tmp_path / "clock.py", tmp_path / "clock.fmu", fmi=version, backend=backend)
    system = vdfmu.connect({"a": fmu}, stop=1.0, step=0.5)
    ends = {name: system.run(parameters={"a.mode": name})["a.y"][-1] for name in ("right", "fast", "stopped")}
    assert ends == {"right": 1.0, "fast": 2.0, "stopped": 0.0}
    fixed = vdfmu.build(tmp_path / "clock.py", tmp_path / "fixed.fmu", fmi=version, backend=backend, mode="fast")
    assert vdfmu.load(fixed).run(stop=1.0, step=0.5)["fixed.y"][-1] == 2.0
    done = command("run", f"a={fmu}", "--set", "a.mode=fast", "--stop", "1", "--step", "0.5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_run(tmp_path / "results" / "system").results["a.y"][-1] == 2.0
    refused = command("run", f"a={fmu}", "--set", "a.mode=slow", "--stop", "1", "--step", "0.5", cwd=tmp_path)
    assert refused.returncode == 2 and "expected right or fast or stopped" in refused.stderr, refused.stderr


ROOM = '''
from vdfmu.unit import Derivative, Event, Mode, State, Unit, where


class Room(Unit):
    """Room with a heater that switches by its temperature."""

    T = State("K", text="temperature above the surroundings")
    T_dot = Derivative(T)
    heater = Mode("on", "off", text="heater")
    hot = Event("K", text="temperature above the upper limit")
    cold = Event("K", text="temperature below the lower limit")

    def derivatives(self) -> None:
        self.T_dot = (where(self.heater < 0.5, 40.0, 0.0) - self.T) / 100.0

    def events(self) -> None:
        self.hot, self.cold = self.T - 21.0, 19.0 - self.T

    def at_hot(self) -> None:
        self.heater = "off"

    def at_cold(self) -> None:
        self.heater = "on"
'''


@pytest.mark.heavy
@pytest.mark.parametrize(("version", "backend"), [("2.0", "native"), ("3.0", "native"), ("2.0", "python")])
def test_a_mode_is_an_output_with_names_in_every_fmu(tmp_path, version, backend):
    (tmp_path / "room.py").write_text(ROOM)
    fmu = vdfmu.build(tmp_path / "room.py", tmp_path / "room.fmu", fmi=version, backend=backend)
    assert inspect_file(fmu).problems == []
    fmpy.read_model_description(str(fmu), validate=True)
    system = vdfmu.connect({"a": fmu}, stop=200.0, step=1.0)
    results = system.run()
    # from 0 to 21 of 40 K, and from there between 19 and 21 K, where heating and cooling take as long
    first, period = 100.0 * math.log(40.0 / 19.0), 100.0 * math.log(21.0 / 19.0)
    switched = np.arange(first, 200.0, period)
    count = np.searchsorted(switched, results.time)  # no switch is within 0.05 s of a row
    assert results.texts("a.heater").tolist() == np.where(count % 2, "off", "on").tolist()
    assert ["a.heater", "on", "off"] in [[row[0], *row[3:]] for row in results.contents().rows]
    cold = system.run(parameters={"a.heater_0": "off", "a.T_0": 20.0})
    assert cold.texts("a.heater")[:6].tolist() == ["off"] * 6 and "on" in cold.texts("a.heater")
    with pytest.raises(VdfmuError, match=r"texts: a\.T must be an enumeration or a mode"):
        results.texts("a.T")
    if backend == "native":
        events = fmpy.simulate_fmu(str(fmu), fmi_type="ModelExchange", stop_time=200.0, output=["T", "heater"])
        assert abs(np.count_nonzero(np.diff(events["heater"])) - len(switched)) <= 1  # of the last one
    (tmp_path / "wrong.py").write_text(ROOM.replace('self.heater = "off"', 'self.heater = "of"'))
    with pytest.raises(VdfmuError, match=r"Room\.heater: expected on or off, got 'of'"):
        vdfmu.build(tmp_path / "wrong.py", tmp_path / "wrong.fmu", fmi=version, backend=backend)


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
