"""Times, counts and flags that an FMU reports: within the step, or the run ends with a sentence."""

import math
import zipfile
from types import SimpleNamespace

import fmpy
import pytest
from fmpy.fmi3 import FMU3Slave

from tests.conftest import heavy
from tests.wild import build
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator
from vdfmu.engine.fmu.versions import Instance2, Instance3
from vdfmu.engine.run import simulate

ENDS, EARLY, EVENT = 1, 2, 3
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Times" instantiationToken="times">
  <CoSimulation modelIdentifier="times" canHandleVariableCommunicationStepSize="true" hasEventMode="{}"/>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    <Float64 name="way" valueReference="1" causality="parameter" variability="fixed" start="0"/>
    <Float64 name="reported" valueReference="2" causality="parameter" variability="fixed" start="0"/>
    <Float64 name="from" valueReference="3" causality="parameter" variability="fixed" start="0"/>
    <Float64 name="y" valueReference="4" causality="output"/>
    <Boolean name="b" valueReference="5" causality="output"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="4"/><Output valueReference="5"/>
  <InitialUnknown valueReference="4"/><InitialUnknown valueReference="5"/></ModelStructure>
</fmiModelDescription>"""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("times"), "times", FMU3Slave)


@pytest.fixture
def package(library, pack, xml, tmp_path):
    """Return a function that makes a package with the unit of times.c, with event mode or without."""

    def made(events):
        fmu = tmp_path / "times.fmu"
        with zipfile.ZipFile(fmu, "w") as archive:
            archive.writestr("modelDescription.xml", DESCRIPTION.format(str(events).lower()))
            archive.write(library, f"binaries/{fmpy.platform_tuple}/{library.name}")
        component = xml.component("unit", "times", "y:output b:output:Boolean")
        return pack([component], extra={"resources/times.fmu": fmu.read_bytes()})

    return made


@pytest.mark.parametrize(
    ("reported", "way", "isolate"),
    [(reported, way, False) for reported in (4.0, 1e308, math.nan, -1.0) for way in (ENDS, EARLY)]
    + heavy((4.0, EARLY, True)),
)
def test_a_time_outside_of_the_step_ends_the_run_with_its_component(package, reported, way, isolate):
    """In C steps, without isolation, and in those of Python. A step is 0.25 s; `reported` counts steps."""
    parameters = {"unit.way": way, "unit.from": 0.5, "unit.reported": 1e99 if math.isnan(reported) else reported}
    with pytest.raises(CosimError) as failed:
        simulate(package(False), stop=1.0, step=0.25, parameters=parameters, isolate=isolate)
    shown = f"{0.5 + reported * 0.25:.9g}"
    assert (failed.value.unit, failed.value.call) == ("unit", "doStep")
    assert f"it reports that the step from t = 0.5 s to t = 0.75 s ended at t = {shown} s" in str(failed.value)


@pytest.mark.parametrize("reported", [1.0 + 4e-10, 1.0, 1.0 - 4e-10])
def test_a_time_within_the_rounding_of_the_step_is_its_end(package, reported):
    """4e-10 of a step is less than what a clock loses that adds up steps, 1e-9 of its time. Flags have all bits set."""
    parameters = {"unit.way": EARLY, "unit.reported": 1e99 if math.isnan(reported) else reported}
    results = simulate(package(False), stop=1.0, step=0.25, parameters=parameters, isolate=False)
    assert results["unit.y"].tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert results["unit.b"].tolist() == [1] * 5
    assert results.summary["stepper"] == "c"


@pytest.mark.parametrize(
    ("way", "words"),
    [(EARLY, "it returned early at t = 0.5 s, where it began"), (EVENT, "it returned early 1000 times")],
)
def test_a_step_that_never_advances_ends_the_run(package, way, words):
    parameters = {"unit.way": way, "unit.from": 0.5, "unit.reported": 0.0}
    with pytest.raises(CosimError, match=words):
        simulate(package(True), stop=1.0, step=0.25, parameters=parameters, isolate=False)


def box():
    return SimpleNamespace(time=2.0, ended={}, pending=[])


@pytest.mark.parametrize(("reported", "ended"), [(1.5, 1.5), (2.0, 2.0), (3.0, None), (0.9, None), (1e308, None)])
def test_the_last_successful_time_of_fmi_2_lies_in_the_discarded_step(reported, ended):
    class Discards(Instance2):
        def __init__(self):
            self.name, self.box, self.fmu = "unit", box(), SimpleNamespace(component=None)
            self.step = SimpleNamespace(value=1.0), SimpleNamespace(value=1.0)

        def function(self, name):
            def answer(component, kind, value):
                value._obj.value = 1 if name == "GetBooleanStatus" else reported
                return 0

            return answer

    unit = Discards()
    if ended is None:
        with pytest.raises(CosimError, match=r"the step from t = 1 s to t = 2 s ended at"):
            unit.has_ended()
    else:
        assert unit.has_ended() and unit.box.ended == {"unit": ended}


@pytest.mark.parametrize(("next_event", "accepted"), [
    (2.5, True), (2.0, True), (2.0 - 1e-9, True), (math.inf, True),  # 1e-9 s: half of what a clock loses by then
    (1.9, False), (-math.inf, False), (math.nan, False),
])  # fmt: skip
def test_the_next_event_is_not_in_the_past(next_event, accepted):
    class Updated(Instance):
        def __init__(self):
            self.name, self.box = "unit", box()

        def updated(self):
            return False, False, next_event

    unit = Updated()
    if accepted:
        unit.update(2.0)
        assert unit.next_event == next_event
    else:
        with pytest.raises(CosimError, match="its next event must not be before this time"):
            unit.update(2.0)


@pytest.mark.parametrize("interval", [-1.0, math.nan, math.inf])
def test_an_interval_of_a_clock_is_a_length_of_time(interval):
    class Ticks(Instance3):
        def __init__(self):
            self.name, self.box = "unit", box()

        def call(self, name, references, n, intervals, qualifiers):
            intervals[0], qualifiers[0] = interval, 2

    with pytest.raises(CosimError, match="expected the interval of a clock"):
        Ticks().intervals([1])


@pytest.mark.parametrize(("sizes", "words"), [((2**60, 0), "continuous states"), ((1, 2**32 - 1), "event indicators")])
def test_numbers_without_memory_are_refused_before_memory_is_asked_for(sizes, words):
    unit = SimpleNamespace(name="unit", box=box(), sizes=lambda: sizes)
    with pytest.raises(CosimError, match=rf"\d+ {words}.*; expected 10000000 at most of each"):
        ModelExchangeIntegrator(unit, None)
