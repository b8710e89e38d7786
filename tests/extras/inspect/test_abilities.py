"""Calls that an FMU declares and that do not work, one broken at a time: the FMU of ``claims.c``."""

import re
from dataclasses import replace

import pytest

from tests.engine.reference import models
from tests.wild import build, pack
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.run import simulate

XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Claims" guid="{0}">
  <CoSimulation modelIdentifier="claims" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
    canSerializeFMUstate="true" providesDirectionalDerivative="true"/>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="u" valueReference="100" causality="input"><Real start="0"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1"/></Outputs>
  <InitialUnknowns><Unknown index="1"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""
BROKEN = (
    None,
    r"the process crashed \(signal 11\) in setReal in the test of the calls that it declares",
    "FMU state .canGetAndSetFMUState.: FMU failed .* in getFMUstate: this unit has no state",
    "repeated from the saved state, gives y = ",
    "FMU state .canSerializeFMUState.: FMU failed .* in deSerializeFMUstate: the bytes are of another version",
    "directional derivatives: FMU failed .* in getDirectionalDerivative: not implemented",
    "directional derivatives: y by u is nan",
    "closed files of the process",
    r"gives y = 160285\.1392; the first time it gave 160285\.139$",
)
"""What the check says of each way of ``claims.c``; the first is sound."""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("claims"), "claims")


@pytest.mark.few(2)
@pytest.mark.parametrize("way", range(len(BROKEN)))
def test_a_declared_call_that_does_not_work_is_a_problem(way, library, tmp_path):
    path = pack(tmp_path / "claims.fmu", library, XML.format(way))
    problems = inspect_file(path).problems
    if BROKEN[way] is None:
        assert problems == []
    else:
        text = "\n".join(problems)
        assert re.search(BROKEN[way], text, re.MULTILINE), text
        assert {problem.rule.number for problem in problems} <= {"RUN002", "RUN009"}


def test_a_unit_with_long_steps_is_told_a_stop_time_beyond_those_that_are_tried(library, tmp_path):
    experiment = '<DefaultExperiment startTime="0" stopTime="50" stepSize="5"/>'
    text = XML.format(0).replace("  <ModelVariables>", f"{experiment}<ModelVariables>")
    path = pack(tmp_path / "claims.fmu", library, text)
    assert inspect_file(path).problems == []


@pytest.mark.heavy
def test_a_unit_that_refuses_its_event_mode_is_a_problem_and_runs_without(system, built, tmp_path):
    """As Roberts of the Reference FMUs does."""
    model = replace(
        models.DAHLQUIST,
        name="Refusing",
        code="#define REFUSES_EVENT_MODE\n" + models.DAHLQUIST.code,
        simulation={"hasEventMode": "true"},
    )
    path = tmp_path / "Refusing.fmu"
    path.write_bytes(built(model, "3.0"))
    (problem,) = inspect_file(path).problems
    assert re.search(
        "event mode .hasEventMode.: FMU failed at t = 0 s in instantiate: Event mode is not supported", problem
    )
    notes = []
    results = simulate(system({"m": (model, "3.0")}), stop=0.2, step=0.1, log=notes.append)
    # explicit Euler at its own step, exact except for rounding
    assert results["m.x"] == pytest.approx([1.0, 0.9, 0.81], rel=1e-15)
    assert any("declares event mode (hasEventMode) but rejects it" in str(note) for note in notes)
