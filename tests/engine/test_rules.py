"""Every rule is broken by a file, and found by its number; so JSON and the page of the rules name them all."""

import io
import json
import stat
import warnings
import zipfile
from pathlib import Path

import pytest

from tests.engine import texts
from tests.engine.files import edited, zipped
from tests.engine.texts import connections, connector_list, elements, parameter, values
from tests.warm import command
from vdfmu.base.errors import SspError
from vdfmu.engine.inspect import trial as check_run
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.package import archive, parse
from vdfmu.engine.package.parse import EXPERIMENT_TYPE, FOREIGN
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.rules import RULES
from vdfmu.system.inspect_source import inspect_source

VARIABLES = """<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="k" valueReference="3" causality="parameter" variability="fixed">
<Real start="1" min="0" unit="m"/></ScalarVariable>"""
UNIT = '<Unit name="m"><BaseUnit m="1"/></Unit>'
STRUCTURE = '<Outputs><Unknown index="2"/></Outputs><InitialUnknowns><Unknown index="2"/></InitialUnknowns>'
VARIABLES_3 = """<Float64 name="time" valueReference="0" causality="independent"/>
<Float64 name="y" valueReference="1" causality="output"><Dimension start="2"/></Float64>
<Float64 name="a" valueReference="2" causality="parameter" variability="tunable" start="0 0"><Dimension start="2"/>
</Float64>"""
STRUCTURE_3 = '<Output valueReference="1"/><InitialUnknown valueReference="1"/>'


def fmu(variables="", inside='<CoSimulation modelIdentifier="m"/>', structure=STRUCTURE, text=None, **members) -> bytes:
    """Return an FMU 2.0 without binaries; `members` by names with `__` for a slash and `_xml` for the ending."""
    text = text or (
        f'<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1">{inside}<UnitDefinitions>{UNIT}'
        f"</UnitDefinitions><ModelVariables>{VARIABLES}{variables}</ModelVariables><ModelStructure>{structure}"
        "</ModelStructure></fmiModelDescription>"
    )
    return zipped({"modelDescription.xml": text, **members})


def fmu3(variables=VARIABLES_3, structure=STRUCTURE_3) -> bytes:
    return fmu(
        text='<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="1">'
        f'<CoSimulation modelIdentifier="m"/><ModelVariables>{variables}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def local(inner: str, attributes="", name="x", reference=4) -> str:
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}>{inner}</ScalarVariable>'


def ssd(inner="", before="", after="", version="1.0", name="n", outside="") -> str:
    return texts.ssd(f"\n{before}{elements(inner)}{after}", outside, version=version, name=name)


def component(name="c", connectors="", inner="", source="m.fmu", attributes="") -> str:
    return texts.component(name, source, connector_list(connectors) + inner, attributes)


def package(inner="", members=None, unit=b"", **options) -> tuple[str, bytes]:
    content = {"SystemStructure.ssd": ssd(inner, **options), "m.fmu": unit or fmu(), **(members or {})}
    return "x.ssp", zipped(content)


def unit(*arguments, **options) -> tuple[str, bytes]:
    return "x.fmu", fmu(*arguments, **options)


def entries(*changes) -> tuple[str, bytes]:
    """Return a package with more entries, each made by a function of the zip file."""
    box = io.BytesIO(package(component())[1])
    with zipfile.ZipFile(box, "a") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for change in changes:
            change(file)
    return "x.ssp", box.getvalue()


def link(file: zipfile.ZipFile) -> None:
    info = zipfile.ZipInfo("link")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    file.writestr(info, "m.fmu")


GAIN = "u:input y:output"
DICTIONARY = '<ssd:SignalDictionaryReference name="d" dictionary="none"/>'
IN_CIRCLE = (
    '<ssd:System name="{0}"><ssd:Connectors><ssd:Connector name="i" kind="input"/>'
    '<ssd:Connector name="o" kind="output"/>'
    '</ssd:Connectors><ssd:Connections><ssd:Connection startConnector="i" endConnector="o"/></ssd:Connections>'
    "</ssd:System>"
)
ORDERED = (
    '<ssd:DefaultExperiment startTime="0" stopTime="1"><ssd:Annotations>'
    f'<ssc:Annotation type="{EXPERIMENT_TYPE}"><e:Experiment xmlns:e="{FOREIGN["vdfmu"]}" communicationStepSize="0.1" '
    'algorithm="gauss-seidel"/></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>'
)
BOUND = "<ssd:ParameterBindings><ssd:ParameterBinding {}/></ssd:ParameterBindings>"
METRE = (
    '<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit><ssc:Unit name="s"><ssc:BaseUnit s="1"/></ssc:Unit>'
    "</ssd:Units>"
)
STEPS = '<ssd:DefaultExperiment startTime="2" stopTime="1"/>'
BROKEN = {
    "PKG001": lambda: ("x.ssp", b"no zip"),
    "PKG002": lambda: entries(lambda file: file.writestr("../a", "")),
    "PKG003": lambda: entries(link),
    "PKG004": lambda: entries(lambda file: file.writestr("big", bytes(archive.MEMBER_LIMIT + 1))),
    "PKG005": lambda: entries(lambda file: file.writestr("a", "a", zipfile.ZIP_BZIP2)),
    "PKG006": lambda: entries(lambda file: file.writestr("M.FMU", "")),
    "PKG007": lambda: entries(lambda file: file.writestr("m.fmu", file.read("m.fmu"))),
    "PKG008": lambda: ("x.ssp", zipped({"SystemStructure.ssd": "<a>"})),
    "PKG009": lambda: ("x.ssp", zipped({"SystemStructure.ssd": '<!DOCTYPE a [<!ENTITY e "x">]><a/>'})),
    "SSP001": lambda: ("x.ssp", zipped({"B.ssd": ssd()})),
    "SSP002": lambda: ("x.ssp", zipped({"SystemStructure.ssd": "<a/>"})),
    "SSP003": lambda: package(component(attributes='odd="1"')),
    "SSP004": lambda: ("x.ssp", zipped({"SystemStructure.ssd": '<?xml version="1.0" encoding="ISO-8859-1"?>' + ssd()})),
    "SSP005": lambda: package(component(), version="1.5"),
    "SSP006": lambda: package(component(), {"B.ssd": ssd(component())}),
    "SSP007": lambda: package(component(), {"documentation/a.html": ""}),
    "SSP008": lambda: package(
        component(inner='<ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1" iconSource="none.png"/>')
    ),
    "SSP009": lambda: package(component(), version="2.0"),
    "SSP010": lambda: package(component(), outside=STEPS),
    "SSP011": lambda: package(component(source="none.fmu")),
    "SSP012": lambda: package(component(source="http://a/m.fmu")),
    "SSP013": lambda: package('<ssd:Component name="c"/>', version="2.0"),
    "SSP014": lambda: package(component(attributes='type="text/plain"')),
    "SSP016": lambda: package(
        '<ssd:System name="s"><ssd:Elements>' * 40 + component() + "</ssd:Elements></ssd:System>" * 40
    ),
    "SSP017": lambda: package(component() * 2),
    "SSP018": lambda: package(component(connectors="u:input u:input")),
    "SSP020": lambda: package(DICTIONARY),
    "SSP021": lambda: package(
        component("a.b") + f'<ssd:System name="a"><ssd:Elements>{component("b")}</ssd:Elements></ssd:System>'
    ),
    "SSP022": lambda: package(component(connectors="u:input:Real:mile")),
    "SSP023": lambda: package(),
    "SSP030": lambda: package(component("a", GAIN), after=connections("a.y a.w")),
    "SSP031": lambda: package(component("a", GAIN) + component("b", GAIN), after=connections("a.y b.y")),
    "SSP032": lambda: package(component("a", GAIN) + component("b", GAIN), after=connections("a.y b.u", "b.y b.u")),
    "SSP033": lambda: package(
        component("a", GAIN) + component("b", "i:input"), after=connections("a.y b.i"),
        unit=fmu(local('<Integer start="0"/>', 'causality="input" variability="discrete"', "i")),
    ),
    "SSP034": lambda: package(
        component("a", "y:output:Real:s") + component("b", "u:input:Real:m"), after=connections("a.y b.u"),
        outside=METRE,
    ),
    "SSP035": lambda: package(
        component("a", "y:output") + component("b", "u:input"), version="2.0",
        after=connections("a.y b.u").replace("<ssd:Connection ", '<ssd:Connection startIndices="1" '),
    ),
    "SSP036": lambda: package(
        component("a", GAIN) + component("b", GAIN),
        after=connections("a.y b.u", inner='<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/>'
                          "</ssc:IntegerMappingTransformation>"),
    ),
    "SSP037": lambda: package(
        IN_CIRCLE.format("a") + IN_CIRCLE.format("b"), before=values("a.i=1"),
        after=connections("a.o b.i", "b.o a.i"),
    ),
    "SSP038": lambda: package(component()),
    "SSP039": lambda: package(component("a", GAIN), after=connections("a.y a.u"), outside=ORDERED),
    "SSP040": lambda: package(component(connectors="w:input")),
    "SSP041": lambda: package(component(connectors="u:output")),
    "SSP042": lambda: package(component(connectors="u:input:Integer")),
    "SSP043": lambda: package(component(connectors="k:parameter:Real:s"), outside=METRE),
    "SSP044": lambda: package(component(connectors="y:output"), unit=fmu3(), version="2.0"),
    "SSP045": lambda: package(component(attributes='implementation="ModelExchange"')),
    "SSP046": lambda: package(
        component("a") + component("b"),
        unit=fmu(inside='<CoSimulation modelIdentifier="m" canBeInstantiatedOnlyOncePerProcess="true"/>'),
    ),
    "SSP050": lambda: package(component(inner=BOUND.format(""))),
    "SSP051": lambda: package(component(inner=values("k=1", "k=2"))),
    "SSP052": lambda: package(component(inner=values("none=1"))),
    "SSP053": lambda: package(component(inner=values("y=1"))),
    "SSP054": lambda: package(component(inner=values(parameter("k", "a", "String")))),
    "SSP055": lambda: package(component(inner=values(parameter("k", unit="s"))), outside=METRE),
    "SSP056": lambda: package(component(inner=values("k=-1"))),
    "SSP057": lambda: package(
        component(),
        before='<ssd:Connectors><ssd:Connector name="w" kind="input"/></ssd:Connectors>' + values("w=1"),
    ),
    "SSP058": lambda: package(
        component("a", "y:output:Real:s") + component("b", "u:input:Real:m"), outside=METRE,
        after=connections("a.y b.u").replace("<ssd:Connection ", '<ssd:Connection suppressUnitConversion="true" '),
    ),
    "SSP059": lambda: package(component("a", GAIN), after=connections("a.y a.u")),
    "FMI001": lambda: ("x.fmu", zipped({"a": ""})),
    "FMI002": lambda: unit(text='<fmiModelDescription fmiVersion="4.0"/>'),
    "FMI003": lambda: unit(text='<fmiModelDescription fmiVersion="2.0"/>'),
    "FMI004": lambda: unit(local('<Real declaredType="None"/>')),
    "FMI005": lambda: unit(local('<Real unit="mile"/>')),
    "FMI006": lambda: unit(local('<Real start="0"/>', 'causality="parameter"')),
    "FMI007": lambda: unit(local('<Real derivative="99"/>')),
    "FMI008": lambda: ("x.fmu", fmu3(VARIABLES_3.replace('<Dimension start="2"/>', '<Dimension valueReference="1"/>'))),
    "FMI009": lambda: unit(local('<Real start="5" max="1"/>', 'initial="exact"')),
    "FMI010": lambda: unit(local('<Real start="0"/>', 'causality="input" initial="exact"')),
    "FMI011": lambda: unit(local('<Real start="0" unit="m"/>', reference=1)),
    "FMI012": lambda: unit(local("<Real/>", name="y")),
    "FMI013": lambda: unit(structure=""),
    "FMI014": lambda: unit(
        inside='<CoSimulation modelIdentifier="m"><SourceFiles><File name="a.c"/></SourceFiles></CoSimulation>'
    ),
    "FMI015": lambda: unit(**{
        "terminalsAndIcons/terminalsAndIcons.xml":
        '<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals><Terminal name="t" matchingRule="bus">'
        '<TerminalMemberVariable variableName="w"/></Terminal></Terminals></fmiTerminalsAndIcons>'
    }),
    "FMI016": lambda: unit(
        text=zipfile.ZipFile(io.BytesIO(fmu())).read("modelDescription.xml").decode()
        .replace("<ModelVariables>", '<DefaultExperiment startTime="2" stopTime="1"/><ModelVariables>')
    ),
    "FMI017": lambda: unit(),
    "FMI018": lambda: unit(**{"binaries/linux64/m.so": "text"}),
    "FMI019": lambda: unit(inside='<ModelExchange modelIdentifier="m"/>'),
    "FMI020": lambda: unit(local('<Real nominal="0"/>')),
    "FMI021": lambda: unit(**{
        "extra/org.example/fmi-ls-manifest.xml":
        '<m xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" fmi-ls:fmi-ls-version="1.0"/>'
    }),
    "FMI022": lambda: unit(**{
        "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml":
        '<fmiReferences xmlns:l="http://fmi-standard.org/fmi-ls-manifest" l:fmi-ls-name="n" l:fmi-ls-version="1.0">'
        '<Related source="a" role="results"/></fmiReferences>'
    }),
    "FMI023": lambda: unit(
        text=zipfile.ZipFile(io.BytesIO(fmu())).read("modelDescription.xml").decode()
        .replace("<fmiModelDescription", '<fmiModelDescription numberOfEventIndicators="4294967295"')
    ),
    "FMI024": lambda: unit(
        inside='<CoSimulation modelIdentifier="m"><SourceFiles><File name="a.c"/></SourceFiles></CoSimulation>',
        **{"binaries/linux64/m.so": "text"},
    ),
    "RUN006": lambda: unit(),
    "RUN007": lambda: package(
        component(),
        unit=fmu(
            text='<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="1" '
            'numberOfContinuousStates="0" numberOfEventIndicators="0"/>'
        ),
    ),
    "RUN008": lambda: unit(
        text='<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="1" '
        'numberOfContinuousStates="0" numberOfEventIndicators="0"/>'
    ),
    "RUN010": lambda: package(
        component("a", GAIN) + component("b", GAIN), after=connections("a.y b.u"),
        outside=ORDERED.replace("gauss-seidel", "iterative"),
    ),
    "SRC001": lambda: ("x.toml", b"name = 3"),
    "SRC002": lambda: (
        "x.toml",
        b'name = "x"\nrobot = "planar_2dof"\nstop = 1.0\nstep = 0.001\n'
        b"[trajectory]\nq_start = [90.0, 0.0]\n",
    ),
}  # fmt: skip
RUN = ("RUN001", "RUN002", "RUN005")
"""Rules that only a run breaks."""
OF_TRIALS = ("RUN003", "RUN004", "RUN009")
"""Rules that trials of the extra `inspect` break."""


def report_on(path: Path, run=False):
    return inspect_source(path, "planar_2dof", run) if path.suffix == ".toml" else inspect_file(path, run)


def numbers(path: Path, run=False) -> set[str]:
    report = report_on(path, run)
    assert all(hasattr(text, "rule") for text in (*report.problems, *report.notes)), report
    return {text.rule.number for text in (*report.problems, *report.notes)}


def test_every_rule_has_a_file_that_breaks_it():
    assert {*BROKEN, *RUN, *OF_TRIALS} == set(RULES)


@pytest.mark.parametrize("rule", BROKEN)
def test_a_file_that_breaks_a_rule_is_found_by_its_number_and_refused_by_a_problem_only(rule, tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MEMBER_LIMIT", 2**20)
    if rule == "SSP009":
        monkeypatch.setattr(parse, "schema_of", lambda *_: None)
    name, content = BROKEN[rule]()
    (tmp_path / name).write_bytes(content)
    path = tmp_path / name
    assert rule in numbers(path)
    report = report_on(path).to_dict()
    severities = {each["severity"] for each in report["findings"] if each["rule"] == rule}
    assert severities == {RULES[rule].severity}
    # the sentences of a note are among the notes alone, and no run is refused by them
    is_problem = any(each.rule.number == rule for each in report["problems"])
    assert is_problem == (RULES[rule].severity == "problem")
    refused = []
    if path.suffix == ".ssp":
        try:
            check_system(load_ssp(path), algorithm=check_run.master_of(load_ssp(path)))
        except SspError as error:
            refused = [each.rule.number for each in error.problems]
    assert RULES[rule].severity == "problem" or rule not in refused


@pytest.mark.heavy
def test_rules_that_a_run_breaks(fmus, pack, xml, tmp_path):
    fragile = pack([xml.component("f", "Fragile", "", xml.values(xml.real("at", 0.0)))])
    with zipfile.ZipFile(fmus["Gain"]) as file:
        (script,) = (n for n in file.namelist() if n.startswith("resources/vdfmu_test"))
    path = tmp_path / "ended.fmu"
    path.write_bytes(edited(fmus["Gain"], add={script: "import os\nos._exit(0)\n"}))
    broken = {
        "RUN001": numbers(fragile, True), "RUN002": numbers(path, True), "RUN005": numbers(fmus["Dividing"], True),
    }  # fmt: skip
    assert {rule for rule, got in broken.items() if rule in got} == set(RUN), broken


def test_the_run_apart_hands_its_findings_over_with_their_rules(fmus):
    findings = check_run.run_apart(fmus["Dividing"])
    (note,) = findings.notes
    assert note.rule.number == "RUN005"


def test_json_names_rule_file_and_line(tmp_path):
    name, content = package(component(connectors="w:input"), {"m.fmu": fmu(local('<Real unit="mile"/>'))})
    (tmp_path / name).write_bytes(content)

    done = command("check", "--no-run", tmp_path / name, "--json")
    assert done.returncode == 1, done.stderr
    findings = json.loads(done.stdout)["findings"]
    assert findings[0] == {
        "rule": "SSP040", "severity": "problem", "file": "x.ssp: SystemStructure.ssd", "line": 2,
        "message": "c.w: m.fmu has no such variable", "fix": "correct the name",
    }  # fmt: skip
    assert ("FMI005", "x.ssp: m.fmu: modelDescription.xml") in {(f["rule"], f["file"]) for f in findings}


@pytest.mark.heavy
def test_what_a_check_prints_is_bounded_however_long_names_and_lists_are(tmp_path):
    path, long = tmp_path / "x.toml", "n" * 2_000_000
    path.write_text(f'name = "x"\n{long} = 1\n' + "".join(f"k{i} = 1\n" for i in range(9_000)))
    done = command("check", path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert len(done.stdout) < 25 * 2200  # FEW lines of a rule, each of 2,000 characters and its place
