"""`vdfmu check` on faulty systems of SSP 1.0: the faults of all layers at once, and rules of the files."""

import pytest

from tests.engine import texts
from tests.engine.files import check_file, zipped
from tests.engine.texts import connections, connector_list, parameter, values

DESCRIPTION = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1">\
<CoSimulation modelIdentifier="m"/>{before}<ModelVariables>
<ScalarVariable name="u" valueReference="1" causality="input"><Real start="{start}"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="k" valueReference="3" causality="parameter" variability="fixed">
<Real start="1"{limits}/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="2"/></Outputs><InitialUnknowns><Unknown index="2"/>
</InitialUnknowns></ModelStructure></fmiModelDescription>"""


def fmu(start="0", limits="", before=""):
    return zipped({"modelDescription.xml": DESCRIPTION.format(start=start, limits=limits, before=before)})


def ssd(parts, before="", after="", name="n"):
    return texts.ssd(f"\n{before}<ssd:Elements>{parts}</ssd:Elements>{after}", name=name)


def component(name, connectors="", source="resources/m.fmu", inner="", attributes=""):
    return texts.component(name, source, f"\n{connector_list(connectors)}{inner}", attributes)


@pytest.fixture
def package(tmp_path):
    def write(text, members=None):
        path = tmp_path / "x.ssp"
        path.write_bytes(zipped({"SystemStructure.ssd": text, "resources/m.fmu": fmu(), **(members or {})}))
        return path

    return write


def problems(path):
    return [p for p in check_file(path, run=False) if "no binary for this platform" not in p]


def test_faults_of_all_layers_come_at_once(package):
    text = ssd(
        component("c", "u:output zz:input")
        + component("e", source="resources/none.fmu")
        + component("f", source="resources/text.fmu"),
        '<ssd:ParameterBindings><ssd:ParameterBinding source="resources/none.ssv"/></ssd:ParameterBindings>',
        connections("c.u d.u"),
    )
    path = package(text, {"resources/m.fmu": fmu("abc"), "resources/text.fmu": "text"})
    *faults, binary, last = check_file(path, run=False)
    assert faults == [
        "x.ssp: component 'e': the package has no 'resources/none.fmu'",
        "x.ssp: the package has no 'resources/none.ssv'",
        "connection c.u -> d.u: there is no element 'd'",
        "c.u: the SSD declares kind 'output', the FMU causality 'input'",
        "c.zz: resources/m.fmu has no such variable",
        "resources/m.fmu: modelDescription.xml, line 2: Element 'Real', attribute 'start': 'abc' is not a valid value "
        "of the atomic type 'xs:double'.",
    ]
    assert binary.startswith("resources/m.fmu: no binary for this platform")
    assert last.startswith("resources/text.fmu: text.fmu is not a readable FMU: cannot be read as")


def test_fmus_are_checked_where_the_system_cannot_be_read_and_units_are_defined_where_named(package):
    faults = check_file(package("<ssd:System>", {"resources/m.fmu": fmu("abc")}), run=False)
    assert faults[0].startswith("x.ssp: SystemStructure.ssd: is not well-formed XML")
    assert faults[1].startswith("resources/m.fmu: modelDescription.xml, line 2: Element 'Real'")
    text = ssd(component("c", "u:input:Real:rad y:output:Real:rad", inner=values(parameter("k", unit="furlong"))))
    assert problems(package(text)) == [
        "x.ssp: SystemStructure.ssd: unit 'rad' of c.u and 1 more is not defined; define it in ssd:Units",
        "x.ssp: SystemStructure.ssd, line 3: unit 'furlong' of k is not defined; define it in ssv:Units",
    ]
    base = '"><ssc:BaseUnit m="1"/></ssc:Unit>'
    units = f'<ssd:Units><ssc:Unit name="rad{base}<ssc:Unit name="furlong{base}</ssd:Units>'
    assert problems(package(text.replace("</ssd:System>", "</ssd:System>" + units))) == []
