"""FMUs of FMI 1.0 for co-simulation: the FMU of ``first.c``, held against fmpy's own run of it."""

import pytest

from tests.engine.files import assert_same_bits
from tests.wild import build
from tests.wild import pack as pack_fmu
from vdfmu.base.errors import CosimError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.run import Simulator, simulate

VARIABLES = (
    ("x", 0, "internal", "continuous", "Real", ""),
    ("y", 1, "output", "continuous", "Real", "<DirectDependency/>"),
    ("u", 2, "input", "continuous", "Real", 'start="0"'),
    ("k", 3, "internal", "parameter", "Real", 'start="1"'),
    ("most", 4, "internal", "parameter", "Real", 'start="1e9"'),
    ("warns", 6, "internal", "parameter", "Real", 'start="0"'),
    ("direct", 5, "output", "continuous", "Real", "<DirectDependency><Name>u</Name></DirectDependency>"),
    ("n", 0, "output", "discrete", "Integer", "<DirectDependency/>"),
    ("word", 0, "internal", "parameter", "String", 'start="none"'),
)


def description(guid: str = "{first}", implementation: str = "CoSimulation_StandAlone", warns: int = 0) -> str:
    variables = ""
    for name, reference, causality, variability, kind, more in VARIABLES:
        more = f'start="{warns}"' if name == "warns" else more
        value = f"<{kind} {more}/>" if more.startswith("start") else f"<{kind}/>{more}"
        variables += (
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
            f'variability="{variability}">{value}</ScalarVariable>'
        )
    capabilities = '<Capabilities canHandleVariableCommunicationStepSize="true"/>'
    part = f"<Implementation><{implementation}>{capabilities}</{implementation}></Implementation>"
    return (
        f'<fmiModelDescription fmiVersion="1.0" modelName="first" modelIdentifier="first" guid="{guid}" '
        'numberOfContinuousStates="0" numberOfEventIndicators="0"><DefaultExperiment startTime="0" stopTime="1"/>'
        f"<ModelVariables>{variables}</ModelVariables>{part if implementation else ''}</fmiModelDescription>"
    )


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("first"), "first")


@pytest.fixture
def first(library, tmp_path):
    """Return the FMU."""
    return pack_fmu(tmp_path / "first.fmu", library, description())


@pytest.fixture
def looped(pack, xml, first):
    """Return a package: a ramp feeds the unit, which feeds a gain."""
    outputs = "u:input y:output direct:output n:output:Integer"
    return pack(
        ["r Ramp y:output", xml.component("f", "first", outputs), "g Gain u:input y:output"],
        ["r.y -> f.u", "f.direct -> g.u"], extra={"resources/first.fmu": first.read_bytes()},
    )  # fmt: skip


def test_it_is_reset_between_runs(looped):
    with Simulator(looped, isolate=False) as simulator:
        runs = [simulator.run(stop=1.0, step=0.25, parameters={"f.k": k}) for k in (2.0, 1.0, 2.0)]
    assert runs[0]["f.y"].tolist() == runs[2]["f.y"].tolist() == (2.0 * runs[1]["f.y"]).tolist()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"f.k": -1.0}, r"f failed at t = 0 s in initializeSlave: k = -1 is negative \(status error\)"),
        ({"f.most": 0.5}, r"f failed at t = 0\.5 s in doStep: no step beyond 0\.5 s \(status error\)"),
    ],
)
def test_a_failure_has_its_call_and_its_message(looped, parameters, message):
    with pytest.raises(CosimError, match=message):
        simulate(looped, stop=1.0, step=0.25, isolate=False, parameters=parameters)


def test_a_message_before_there_is_an_instance_is_told(pack, xml, library, tmp_path):
    other = pack_fmu(tmp_path / "other.fmu", library, description("{other}"))
    path = pack([xml.component("f", "first", "")], extra={"resources/first.fmu": other.read_bytes()})
    with pytest.raises(CosimError, match=r"f failed at t = 0 s in instantiate: the GUID \{other\} is wrong"):
        simulate(path, stop=1.0, step=0.25, isolate=False)


def test_the_check_runs_it_and_says_that_model_exchange_has_no_master(first, library, tmp_path):
    report = inspect_file(first)
    assert (report.problems, report.notes, report.ran, report.standard) == ([], [], True, "FMI 1.0")
    exchange = pack_fmu(tmp_path / "exchange.fmu", library, description(implementation=""))
    assert any(note.rule.number == "RUN008" for note in inspect_file(exchange, run=False).notes)


@pytest.mark.heavy
def test_a_unit_whose_initialization_and_steps_warn_is_checked_and_runs(pack, xml, library, tmp_path):
    """FMPy takes both statuses for texts, and would read a warning, 1, as an address."""
    path = pack_fmu(tmp_path / "first.fmu", library, description(warns=1))
    findings = inspect_file(path)
    assert (findings.problems, findings.ran) == ([], True)
    package = pack([xml.component("f", "first", "")], extra={"resources/first.fmu": path.read_bytes()})
    assert simulate(package, stop=1.0, step=0.25, isolate=False)["f.n"].tolist() == [0, 1, 2, 3, 4]


def test_steps_in_c_have_the_same_bits(pack, xml, first):
    path = pack([xml.component("f", "first", "")], extra={"resources/first.fmu": first.read_bytes()})
    in_c, by_fmpy = (simulate(path, stop=1.0, step=0.25, stepper=stepper, isolate=False) for stepper in ("c", "fmpy"))
    assert_same_bits(in_c, by_fmpy)
    assert in_c.summary["stepper"] == "c"
