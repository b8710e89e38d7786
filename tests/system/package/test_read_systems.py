"""Systems in the forms of SSP 1.0: nested, with several SSDs; no references to systems of other files or by id."""

from pathlib import Path

import fmpy
import pytest

from tests.engine import texts
from tests.engine.texts import SPACES, connections, connector_list, elements, parameter, ssd, values
from tests.hostile.packages import pack as zipped
from tests.system.package.problems import problems
from vdfmu.base.errors import SspError
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system

PACKAGE = 'type="application/x-ssp-package"'
IO = connector_list("u:input y:output")


def component(name: str, source: str = "f.fmu", inner: str = IO, attributes: str = "") -> str:
    return texts.component(name, source, inner, attributes)


def problems_of_wiring(path: Path) -> list[str]:
    return list(load_ssp(path).problems)


@pytest.fixture
def pack(tmp_path):
    def write(members: dict[str, str | bytes], name: str = "x.ssp") -> Path:
        path = tmp_path / name
        path.write_bytes(zipped(members))
        return path

    return write


def links(path: Path, **options) -> list[str]:
    system = load_ssp(path, **options)
    assert system.problems == ()
    return sorted(map(str, system.connections))


GAIN = IO + elements(component("g")) + connections("u g.u", "g.y y")
"""A system around one component, its connectors passed through."""


def test_systems_of_three_levels_are_flattened_with_their_connectors(pack):
    def nest(name: str, inner: str, of: str) -> str:
        inner = elements(f'<ssd:System name="{of}">{inner}</ssd:System>')
        return f"{IO}{inner}{connections(f'u {of}.u', f'{of}.y y')}"

    deep = nest("", nest("", GAIN, "low"), "middle")
    top = elements(f'<ssd:System name="high">{deep}</ssd:System>', component("a"), component("b"))
    path = pack({"SystemStructure.ssd": ssd(top + connections("a.y high.u", "high.y b.u")), "f.fmu": b""})
    assert links(path) == ["a.y -> high.middle.low.g.u", "high.middle.low.g.y -> b.u"]
    assert all(len(c.hops) == 4 for c in load_ssp(path).connections)


def test_components_that_are_nothing_to_run_are_refused_at_once(pack):
    inner = f'<ssd:System name="e" id="e">{GAIN}</ssd:System>'
    parts = [
        component("a", ""),
        component("b", "b.ssp"),
        component("c", "c.ssp#B.ssd", "", PACKAGE),
        component("d", "d.ssd"),
        component("f", "#e", ""),
        component("g", "g.fmu", ""),
    ]
    why = "is not an FMU (application/x-fmu-sharedlibrary); a system in another file, or by its id, is not read. "
    why += "Write it into this SSD, as ssd:System"
    path = pack({"SystemStructure.ssd": ssd(elements(inner, *parts)), "b.ssp": b"", "f.fmu": b""})
    assert problems(path) == [
        "x.ssp: component 'a': has no source to run; name an FMU",
        f"x.ssp: component 'b': 'b.ssp' of type 'application/x-fmu-sharedlibrary' {why}",
        f"x.ssp: component 'c': 'c.ssp#B.ssd' of type 'application/x-ssp-package' {why}",
        f"x.ssp: component 'd': 'd.ssd' of type 'application/x-fmu-sharedlibrary' {why}",
        f"x.ssp: component 'f': '#e' of type 'application/x-fmu-sharedlibrary' {why}",
        "x.ssp: component 'g': the package has no 'g.fmu'",
    ]


def test_a_package_may_have_several_ssds_and_empty_element_names_mean_the_system_itself(pack):
    """The form of OMSimulator's resources/ParkerSimPack: variants of one system over the same FMUs."""
    path = pack(
        {
            "SystemStructure.ssd": ssd(elements(component("a"), component("b")) + connections("a.y b.u")),
            "VarB.ssd": ssd(elements(component("a"), component("b")) + connections("b.y a.u")),
            "f.fmu": b"",
        }
    )
    assert links(path) == ["a.y -> b.u"]
    assert links(path, variant="VarB.ssd") == ["b.y -> a.u"]
    with pytest.raises(SspError, match=r"no 'VarC.ssd'; it has SystemStructure.ssd, VarB.ssd"):
        load_ssp(path, variant="VarC.ssd")
    # The form of OMSimulator's resources/import_export_parameters: startElement="" .
    link = connections("u a.u").replace("<ssd:Connection ", '<ssd:Connection startElement="" ')
    path = pack({"SystemStructure.ssd": ssd(IO + values("u=7") + elements(component("a")) + link), "f.fmu": b""})
    assert load_ssp(path).problems == ()
    assert [(p.name, p.value) for p in load_ssp(path).component("a").parameters] == [("u", 7.0)]


def test_external_files_outside_the_resources_folder_with_prefix_and_precedence(pack):
    """The form of ecos' quarter_truck, ssv/ beside resources/. The mapping finds names with their prefix."""
    parameters = f"<ssv:Parameters>{parameter('k', 2)}{parameter('m', 3)}</ssv:Parameters>"
    document = f'<ssv:ParameterSet {SPACES} version="1.0" name="p">{parameters}</ssv:ParameterSet>'
    mapping = (
        f'<ssm:ParameterMapping {SPACES} version="1.0"><ssm:MappingEntry source="a.k" target="a.gain">'
        '<ssc:LinearTransformation factor="10" offset="1"/></ssm:MappingEntry></ssm:ParameterMapping>'
    )
    top = (
        '<ssd:ParameterBindings><ssd:ParameterBinding prefix="a." source="ssv/top%20values.ssv">'
        '<ssd:ParameterMapping source="maps/names.ssm"/></ssd:ParameterBinding></ssd:ParameterBindings>'
        + elements(component("a", inner=IO + values("m=9", "n=4")))
    )
    path = pack(
        {"SystemStructure.ssd": ssd(top), "ssv/top values.ssv": document, "maps/names.ssm": mapping, "f.fmu": b""}
    )
    bound = {p.name: p for p in load_ssp(path).component("a").parameters}
    assert {name: p.value for name, p in bound.items()} == {"gain": 2.0, "m": 9.0, "n": 4.0}  # a.m is not mapped
    (hop,) = bound["gain"].hops
    assert hop.transformation is not None
    assert (hop.transformation.factor, hop.transformation.offset) == (10.0, 1.0)


def nested(rest: str, name: str = "B") -> str:
    return f'<ssd:System name="{name}">{rest}</ssd:System>'


def values_of(system) -> dict[str, dict[str, object]]:
    return {c.name: {p.name: p.value for p in c.parameters} for c in system.components}


def test_a_value_goes_to_everything_that_has_its_name(pack):
    """Dots may be part of the names of elements: SSP 1.0, ParameterBindings."""
    inner = nested(elements(component("C", inner=IO + values("k=3")), component("D")))
    twin = component("B.C", inner=IO + values("k=5", "m=6"))
    top = elements(inner, twin, component("a")) + connections("B.C.y a.u")
    members = {"SystemStructure.ssd": ssd(top), "f.fmu": b""}
    system = load_ssp(pack(members))
    assert values_of(system) == {"B.C": {"k": 3.0}, "B.D": {}, "B.C#2": {"k": 5.0, "m": 6.0}, "a": {}}
    assert [str(c) for c in system.connections] == ["B.C#2.y -> a.u"]
    assert system.notes == ("several components have the dotted name B.C: B.C is called B.C#2 here",)
    members["SystemStructure.ssd"] = ssd(values("B.C.k=9") + top)
    bound = values_of(load_ssp(pack(members)))
    assert (bound["B.C"], bound["B.C#2"]) == ({"k": 9.0}, {"k": 9.0, "m": 6.0})


def test_values_of_connectors_that_feed_no_input_have_no_effect(pack):
    """The form of OMSimulator's resources/toplevelparameter1: a parameter that nothing is connected to."""
    connectors = connector_list("K:parameter")
    inner = nested(IO + elements(component("g")) + connections("g.y y"), "S")
    top = connectors + values("K=4", "S.y=5", "S.u=6") + elements(inner, component("h")) + connections("S.y h.u")
    system = load_ssp(pack({"SystemStructure.ssd": ssd(top), "f.fmu": b""}))
    assert values_of(system) == {"S.g": {}, "h": {}}
    assert (system.problems, system.unmatched) == ((), ())
    assert system.notes == (
        "the system: parameter 'K' (p: K): has no effect, nothing of a component is connected to K",
        "S: parameter 'y' (p: S.y): has no effect, S.y is of kind output and has the value of its source",
        "S: parameter 'u' (p: S.u): has no effect, nothing of a component is connected to S.u",
    )


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_connected_takes_the_value_of_its_source_in_any_order(pack, order):
    connectors = connector_list("K:input")
    inner = nested(IO + elements(component("g", inner=IO + values("u=1"))) + connections("u g.u"), "S")
    pairs = ["K=4", "S.u=5", "S.g.u=9"][::order]
    top = connectors + values(*pairs) + elements(inner) + connections("K S.u")
    system = load_ssp(pack({"SystemStructure.ssd": ssd(top), "f.fmu": b""}))
    assert values_of(system) == {"S.g": {"u": 4.0}}
    assert sorted(system.notes) == [
        "S.g: parameter 'u' (p: S.g.u): has no effect, S.g.u is connected to K and takes its value (p: K)",
        "S: parameter 'u' (p: S.u): has no effect, S.u is connected to K and takes its value (p: K)",
    ]


def test_a_system_of_ssp_2_is_read_by_its_own_schema_with_connectors_of_their_sizes(pack):
    """`local` is a kind of connector that only SSP 2.0 has."""
    text = ssd(elements(component("a", inner=connector_list("u:local"))))
    fault, *_ = problems(pack({"SystemStructure.ssd": text}))
    assert fault.startswith("x.ssp: SystemStructure.ssd, line") and "'local' is not an element of the set" in fault
    newer = text.replace('version="1.0"', 'version="2.0"', 1)
    system = load_ssp(pack({"SystemStructure.ssd": newer, "f.fmu": b""}))
    assert (system.version, system.component("a").connectors["u"].kind) == ("2.0", "local")

    def array(size: int) -> str:
        inner = f'<ssc:Float64/><ssc:Dimension size="{size}"/>'
        return f'<ssd:Connectors><ssd:Connector name="y" kind="output">{inner}</ssd:Connector></ssd:Connectors>'

    for size, faults in ((2, []), (3, ["connection a.y -> y: dimension mismatch, an array of 2 to an array of 3"])):
        inside = array(size) + elements(component("a", inner=array(2))) + connections("a.y y")
        assert problems_of_wiring(pack({"SystemStructure.ssd": ssd(inside, version="2.0"), "f.fmu": b""})) == faults


def enumeration_fmu(items: str) -> bytes:
    """Make an FMU with an enumeration in and out; the binary is never loaded here."""
    names = "".join(f'<Item name="{n}" value="{v}"/>' for n, v in (i.split("=") for i in items.split()))
    variables = (
        '<ScalarVariable name="u" valueReference="0" causality="input" variability="discrete">'
        '<Enumeration declaredType="E" start="1"/></ScalarVariable>'
        '<ScalarVariable name="y" valueReference="1" causality="output" variability="discrete" initial="calculated">'
        '<Enumeration declaredType="E"/></ScalarVariable>'
        '<ScalarVariable name="p" valueReference="2" causality="parameter" variability="tunable">'
        '<Enumeration declaredType="E" start="1"/></ScalarVariable>'
    )
    unknowns = '<Unknown index="2" dependencies=""/>'
    text = (
        '<fmiModelDescription fmiVersion="2.0" modelName="E" guid="1"><CoSimulation modelIdentifier="E"/>'
        f'<TypeDefinitions><SimpleType name="E"><Enumeration>{names}</Enumeration></SimpleType></TypeDefinitions>'
        f"<ModelVariables>{variables}</ModelVariables><ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )
    return zipped({"modelDescription.xml": text, f"binaries/{fmpy.platform}/E{fmpy.sharedLibraryExtension}": b""})


def mapped(pack, entries: str, parameter: str = ""):
    table = f"<ssc:EnumerationMappingTransformation>{entries}</ssc:EnumerationMappingTransformation>"
    link = connections("a.y b.u", inner=table)
    top = elements(component("a", "a.fmu"), component("b", "b.fmu", IO + parameter)) + link
    return pack(
        {
            "SystemStructure.ssd": ssd(top),
            "a.fmu": enumeration_fmu("off=1 on=2"),
            "b.fmu": enumeration_fmu("idle=5 running=7 on=2"),
        }
    )


def test_enumerations_of_connections_and_parameter_sets_are_mapped_by_the_names_of_their_items(pack):
    off = '<ssc:MapEntry source="off" target="idle"/>'
    checked = check_system(load_ssp(mapped(pack, off)))
    (link,) = checked.links
    assert link.conversion.table == {1: 5}
    with pytest.raises(SspError, match=r"names 'stop', but items of the target are idle, running, on"):
        check_system(load_ssp(mapped(pack, '<ssc:MapEntry source="off" target="stop"/>')))
    assert problems_of_wiring(mapped(pack, off + off)) == [
        "connection a.y -> b.u: the mapping has several entries for off; keep one"
    ]
    table = (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0"><ssm:MappingEntry source="mode" target="p">'
        '<ssc:EnumerationMappingTransformation><ssc:MapEntry source="go" target="running"/>'
        "</ssc:EnumerationMappingTransformation></ssm:MappingEntry></ssm:ParameterMapping></ssd:ParameterMapping>"
    )
    parameter_set = values("mode=go", mapping=table).replace("ssv:Real", "ssv:Enumeration")
    path = mapped(pack, '<ssc:MapEntry source="off" target="idle"/>', parameter_set)
    ((variable, value),) = check_system(load_ssp(path)).starts["b"]
    assert (variable.name, value) == ("p", 7)
