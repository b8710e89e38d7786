"""Packages like those in the test folders of other tools run, or are refused by the rule that the docs name."""

import re
from pathlib import Path

import pytest

from tests.engine.conftest import make_fmu
from tests.engine.files import edited, zipped
from vdfmu.base.errors import SspError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.package.read import read_system
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run import simulate

STATE = '<ScalarVariable name="x" valueReference="{}"><Real/></ScalarVariable>'
FMI_1 = (
    '<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="1" numberOfContinuousStates="0" '
    f'numberOfEventIndicators="0"><ModelVariables>{STATE.format(1)}{STATE.format(2)}</ModelVariables><Implementation>'
    "<CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation></fmiModelDescription>"
)
OSP = (
    '<ssd:DefaultExperiment startTime="0" stopTime="1"><ssd:Annotations><ssc:Annotation '
    'type="com.opensimulationplatform"><osp:Algorithm xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations">'
    '<osp:FixedStepAlgorithm baseStepSize="0.25"/></osp:Algorithm></ssc:Annotation></ssd:Annotations>'
    "</ssd:DefaultExperiment>"
)
BUS = (
    '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations xmlns:oms="urn:oms"><oms:Bus/>'
    "</oms:Annotations></ssc:Annotation></ssd:Annotations>"
)
TWICE = '<ssc:LinearTransformation factor="2" offset="1"/>'
ENUMERATION = (
    '<ssd:Component name="e" source="resources/e.fmu"><ssd:Connectors><ssd:Connector name="u" kind="input"/>'
    "</ssd:Connectors></ssd:Component>"
)
TAKES_AN_ITEM = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1"><CoSimulation modelIdentifier="m"/>
<TypeDefinitions><SimpleType name="E"><Enumeration><Item name="a" value="1"/></Enumeration></SimpleType>
</TypeDefinitions><ModelVariables><ScalarVariable name="u" valueReference="1" causality="input" variability="discrete">
<Enumeration declaredType="E" start="1"/></ScalarVariable></ModelVariables><ModelStructure/></fmiModelDescription>"""


def fmu(text: str) -> bytes:
    return zipped({"modelDescription.xml": text})


@pytest.fixture
def packages(pack, xml, fmus, tmp_path):
    """Return what makes each package, by the name that it has in the docs."""
    c = xml.component
    chain = [c("r", "Ramp", "y:output"), c("g", "Gain", "u:input y:output")]
    linked = ["r.y -> g.u"]

    def whole(elements, connections, replace=("", ""), **options):
        path = pack(elements, connections, **options)
        old, new = map(str.encode, replace)
        path.write_bytes(edited(path, [(re.escape(old), new)] if old else (), "SystemStructure.ssd"))
        return path

    def renamed(element, source):
        return element.replace("resources/Gain.fmu", source)

    external = '<ssd:ParameterBindings><ssd:ParameterBinding source="resources/a.ssv"/></ssd:ParameterBindings>'
    incomplete = edited(fmus["Gain"], [(rb"<InitialUnknowns>.*</InitialUnknowns>", b"")])
    return {
        "libcosim: demo": lambda: pack(
            [chain[0], renamed(chain[1], "incomplete.fmu")], linked, extra={"incomplete.fmu": incomplete},
            experiment=OSP,
        ),
        "libcosim: linear_transformation": lambda: pack(
            [chain[0], renamed(chain[1], "../../fmi1/identity.fmu")], linked
        ),
        "ecos: dp_ship": lambda: pack([renamed(chain[1], "models/a.fmu")], extra={"models/a.fmu": fmu(FMI_1)}),
        "ecos: quarter_truck": lambda: pack(
            [c("g", "Gain", "", external)], extra={"resources/a.ssv": "<ssv:ParameterSet/>"}
        ),
        "ecos: quarter-truck": lambda: pack([ENUMERATION], extra={"resources/e.fmu": fmu(TAKES_AN_ITEM)}),
        "OMSimulator: LOC": lambda: pack([renamed(chain[1], "resources/none.fmu")]),
        "OMSimulator: embrace_TwoConf": lambda: pack(
            chain, linked, bindings=xml.values(xml.real("g.k", 3.0) + xml.real("g.k", 2.0))
        ),
        "OMSimulator: LinearTransformation": lambda: whole(
            [chain[0], c("g", "Gain", "u:input y:output", BUS)], [xml.connection(linked[0], TWICE)],
            ('version="1.0" name="test"', 'version="2.0" name="test"'),
        ),
        "OMSimulator: toplevelparameter": lambda: pack(chain, linked, bindings=xml.values(xml.real("g.k", 3.0))),
        "OMSimulator: import_export_parameters": lambda: pack(
            chain, linked, bindings=xml.values(
                xml.real("gain", 3.0), mapping='<ssm:MappingEntry source="gain" target="g.k"/>',
            ),
        ),
        "OMSimulator: importStartValues": lambda: whole(
            [], [], ("<ssd:Elements></ssd:Elements>", ""), connectors="u:input"
        ),
        "OMSimulator: invalidSSD": lambda: whole(chain, linked, ('kind="input"', 'kind="input" type="Real"')),
        "OMSimulator: embrace": lambda: pack(
            [c("n", "Counter", "n:output"), ENUMERATION], ["n.n -> e.u"], extra={"resources/e.fmu": fmu(TAKES_AN_ITEM)}
        ),
        "OMSimulator: pwmtest": lambda: pack([ENUMERATION], extra={"resources/e.fmu": fmu(TAKES_AN_ITEM)}),
    }  # fmt: skip


TABLE = dict(
    re.findall(
        r"^\| (\w+: [\w-]+) \| (runs|[A-Z]{3}\d{3}) \|",
        (Path(__file__).parents[2] / "docs" / "interop.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
)
"""Packages and what comes of them, as the page says."""


def test_the_page_names_all(packages):
    assert set(packages) == set(TABLE)


@pytest.mark.parametrize("name", TABLE)
def test_a_package_of_another_tool_runs_or_is_refused_by_a_rule(packages, name):
    path = packages[name]()
    if TABLE[name] == "runs":
        results = simulate(path, stop=1.0, step=None if "libcosim" in name else 0.25)
        factor, offset = {"libcosim: demo": (2.0, 0.0), "OMSimulator: LinearTransformation": (4.0, 2.0)}.get(
            name, (3.0, 0.0)
        )
        # gain and transformation of numbers without rounding; an output is that of the inputs a step before
        assert results["g.y"][1:].tolist() == [factor * t + offset for t in (0.0, 0.25, 0.5, 0.75)]
        return
    system, problems = read_system(path)
    with pytest.raises(SspError) as refused:
        if system is not None:
            check_system(system)
        raise SspError(problems)
    assert TABLE[name] in {problem.rule.number for problem in refused.value.problems}
    assert TABLE[name] in {problem.rule.number for problem in inspect_file(path, run=False).problems}


def test_an_fmu_gets_the_tolerance_of_its_default_experiment(pack, xml, tmp_path):
    """As from FMPy; a tolerance of the user wins, and a parameter `tolerance` is left alone."""
    code = {
        "calc": "pass", "step": "pass",
        "more": "def setup_experiment(self, start, stop, tolerance):\n    self._y = tolerance or -1.0\n",
    }  # fmt: skip
    experiment = [(rb"<ModelVariables>", b'<DefaultExperiment tolerance="1e-4"/><ModelVariables>')]
    extra = {}
    for name, variables in (("Told", "y:output"), ("Own", "y:output tolerance:parameter:Real:1e-4")):
        extra[f"resources/{name}.fmu"] = edited(make_fmu(tmp_path, name, variables, **code), experiment)
    path = pack([xml.component("a", "Told"), xml.component("b", "Own")], extra=extra)
    for tolerance, sent in ((None, [1e-4, -1.0]), (1e-3, [1e-3, 1e-3])):
        results = simulate(path, stop=1.0, step=0.5, tolerance=tolerance, isolate=False)
        assert [results["a.y"][0], results["b.y"][0]] == sent


@pytest.mark.few(1)
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
def test_an_fmu_without_outputs_gives_its_local_variables(pack, xml, tmp_path, algorithm):
    """As the bouncing balls of other tools; a local variable that is not finite ends no run."""
    ball = "self._h += h\nself._n += 1\nself._bad = float('nan')"
    fmu = make_fmu(tmp_path, "Ball", "h:local n:local:Integer bad:local g:parameter:Real:9.81", ball)
    path = pack([xml.component("a", "Ball"), "r Ramp y:output"], extra={"resources/Ball.fmu": fmu.read_bytes()})
    results = simulate(path, stop=1.0, step=0.5, isolate=False, algorithm=algorithm)
    assert results.names == ["a.h", "a.bad", "a.n", "r.y"]
    assert results["a.h"].tolist() == [0.0, 0.5, 1.0] and results["a.n"].tolist() == [0, 1, 2]
    assert simulate(path, stop=1.0, step=0.5, record=["a.n"], isolate=True).names == ["a.n"]


def test_an_fmu_with_missing_initial_unknowns_is_run_if_the_user_asks(fmus):
    """As all FMUs of plain pythonfmu."""
    plain, anyway = inspect_file(fmus["Stock"]), inspect_file(fmus["Stock"], anyway=True)
    assert {problem.rule.number for problem in plain.problems} == {"FMI013"} and not plain.ran
    assert anyway.problems == plain.problems and anyway.ran
    assert "run despite its problems (--run-anyway)" in anyway.notes
    assert not inspect_file(fmus["Stock"], run=False, anyway=True).ran
