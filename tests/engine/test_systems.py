"""Units, transformations, parameter bindings and nested systems, run to their numbers."""

import numpy as np
import pytest

from vdfmu.base.errors import SspError
from vdfmu.engine.fmu.variables import CONVERT_TYPE
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run import simulate

SSV = (
    '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" '
    'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="external">'
    "<ssv:Parameters>{}</ssv:Parameters>{}</ssv:ParameterSet>"
)
SSM = (
    '<ssm:ParameterMapping xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping" '
    'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0">{}</ssm:ParameterMapping>'
)
MM = '<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>'


def bind(*bindings: str) -> str:
    return f"<ssd:ParameterBindings>{''.join(bindings)}</ssd:ParameterBindings>"


def test_units_are_converted_before_a_transformation_unless_that_is_suppressed(pack, xml):
    path = pack(
        ["deg Degrees y:output:Real mm:output degC:output", "rad Radians u:input m:input K:input"],
        ["deg.y -> rad.u", "deg.mm -> rad.m", "deg.degC -> rad.K"],
    )
    results = simulate(path, stop=2.0, step=1.0, algorithm="jacobi", record=["*"])
    np.testing.assert_array_equal(results["rad.u"], np.array([0.0, 0.0, 90.0]) * 0.017453292519943295)
    np.testing.assert_array_equal(results["rad.m"], [0.0, 0.0, 1.5])
    np.testing.assert_array_equal(results["rad.K"], [273.15, 273.15, 283.15])
    assert results.units["rad.u"] == "rad"
    assert results.units["deg.y"] == "deg"
    linear = '<ssc:LinearTransformation factor="2" offset="0.25"/>'
    path = pack(
        ["deg Degrees mm:output y:output", "rad Radians m:input u:input"],
        [xml.connection("deg.mm -> rad.m", linear),
         xml.connection("deg.y -> rad.u", linear, 'suppressUnitConversion="true"')],
    )  # fmt: skip
    results = simulate(path, stop=2.0, step=1.0, record=["*"])
    assert results["rad.m"].tolist() == [0.25, 0.25, 2 * 1.5 + 0.25]
    assert results["rad.u"].tolist() == [0.25, 0.25, 2 * 90 + 0.25]


def test_a_unit_of_a_parameter_is_converted_if_its_dimension_is_the_same(pack, xml):
    binding = xml.values(xml.real("width", 250.0, "mm"))
    path = pack([xml.component("r", "Radians", "", binding)], units=MM)
    assert simulate(path, stop=1.0, step=1.0)["r.y"].tolist() == [0.25, 0.25]
    unit = '<ssc:Unit name="kg"><ssc:BaseUnit kg="1"/></ssc:Unit>'
    path = pack([xml.component("r", "Radians", "", xml.values(xml.real("width", 1.0, "kg")))], units=unit)
    with pytest.raises(SspError, match=r"parameter 'width' .*: unit mismatch, 'kg' \(kg\) to 'm' \(m\)"):
        check_system(load_ssp(path))


def test_external_values_and_a_mapping_that_drops_what_it_does_not_mention(pack, xml):
    twice = '<ssc:LinearTransformation factor="2"/>'
    mapping = f'<ssm:MappingEntry source="w" target="width">{twice}</ssm:MappingEntry>'
    binding = bind(
        '<ssd:ParameterBinding source="parameters/set%20a.ssv">'
        '<ssd:ParameterMapping source="parameters/map.ssm"/></ssd:ParameterBinding>'
    )
    files = {
        "parameters/set a.ssv": SSV.format(xml.real("w", 300.0, "mm"), f"<ssv:Units>{MM}</ssv:Units>"),
        "parameters/map.ssm": SSM.format(mapping),
    }
    path = pack([xml.component("r", "Radians", "", binding)], extra=files)
    assert simulate(path, stop=1.0, step=1.0)["r.y"][-1] == 2 * (300.0 * 0.001)
    mapping = (
        "<ssd:ParameterMapping>" + SSM.format('<ssm:MappingEntry source="gain" target="k"/>')
        + "</ssd:ParameterMapping>"
    )  # fmt: skip
    inner = xml.real("gain", 5.0) + xml.real("u", 2.0) + xml.real("k", 9.0) + xml.real("unrelated", 1.0)
    before = xml.values(xml.real("u", 3.0)).replace("</ssd:ParameterBindings>", "")
    after = xml.values(inner, mapping=mapping).replace("<ssd:ParameterBindings>", "")
    path = pack([xml.component("g", "Gain", "", before + after)])
    assert simulate(path, stop=1.0, step=1.0)["g.y"].tolist() == [15.0, 15.0]


@pytest.mark.heavy
def test_precedence_of_bindings(pack, xml):
    # A later binding wins over an earlier one, the system over its component, the caller over all.
    at_component = bind(*(f'<ssd:ParameterBinding source="{n}.ssv"/>' for n in ("first", "second")))
    files = {
        "first.ssv": SSV.format(xml.real("k", 1.0) + xml.real("u", 7.0), ""),
        "second.ssv": SSV.format(xml.real("k", 2.0), ""),
    }
    elements = [xml.component("a", "Gain", "", at_component), xml.component("b", "Gain", "", at_component)]
    path = pack(elements, bindings=xml.values(xml.real("k", 3.0), attributes='prefix="b."'), extra=files)
    results = simulate(path, stop=1.0, step=1.0)
    assert results["a.y"][0] == 14.0
    assert results["b.y"][0] == 21.0
    assert simulate(path, stop=1.0, step=1.0, parameters={"b.k": 4.0})["b.y"][0] == 28.0


def test_strings_and_booleans_and_integers_as_parameters(pack, xml):
    inner = (
        '<ssv:Parameter name="bi"><ssv:Boolean value="true"/></ssv:Parameter>'
        '<ssv:Parameter name="ii"><ssv:Integer value="41"/></ssv:Parameter>'
    )
    text = '<ssv:Parameter name="word"><ssv:String value="grün"/></ssv:Parameter>'
    path = pack(
        [xml.component("logic", "Logic", "", xml.values(inner)), xml.component("c", "Counter", "", xml.values(text))]
    )
    results = simulate(path, stop=1.0, step=1.0)
    assert results["logic.io"].tolist() == [42, 42]
    assert results["logic.bo"].tolist() == [False, False]
    assert results["c.odd"][0]  # the unit compares the word that it got


@pytest.fixture
def nested(pack, xml):
    """Return ramp -> system connector -> inner gain -> system output -> outer gain, and a bound K."""
    inner = (
        '<ssd:System name="sub"><ssd:Connectors><ssd:Connector name="in" kind="input"/>'
        '<ssd:Connector name="out" kind="output"/><ssd:Connector name="K" kind="parameter"/></ssd:Connectors>'
        f"<ssd:Elements>{xml.component('gain', 'Gain', 'u:input y:output k:parameter')}</ssd:Elements>"
        "<ssd:Connections>"
        + xml.connection("in -> gain.u", '<ssc:LinearTransformation factor="3" offset="1"/>')
        + xml.connection("out -> gain.y")  # reversed: the kinds say where data flows to
        + xml.connection("K -> gain.k")
        + "</ssd:Connections></ssd:System>"
    )
    return pack(
        [inner, "ramp Ramp y:output", "last Gain u:input"],
        [xml.connection("ramp.y -> sub.in", '<ssc:LinearTransformation factor="10"/>'), "sub.out -> last.u"],
        bindings=xml.values(xml.real("sub.K", 0.5) + xml.real("last.k", 4.0)),
    )


def test_nested_systems_are_flattened_and_run_and_pass_parameters_on(nested):
    system = load_ssp(nested)
    assert [c.name for c in system.components] == ["sub.gain", "ramp", "last"]
    assert sorted(map(str, system.connections)) == ["ramp.y -> sub.gain.u", "sub.gain.y -> last.u"]
    assert system.problems == ()
    results = simulate(nested, stop=2.0, step=1.0, parameters={"sub.gain.k": 0.25}, record=["*"])
    u = np.array([0.0, 0.0, 1.0]) * 30.0 + 1.0
    np.testing.assert_array_equal(results["sub.gain.u"], u)
    np.testing.assert_array_equal(results["last.y"], u * 0.25 * 4.0)
    assert simulate(nested, stop=1.0, step=1.0)["sub.gain.y"][0] == 0.5


def test_a_calculated_parameter_feeds_a_parameter_at_initialization(pack, xml):
    path = pack(
        ["g Gain k:parameter", "d Derived twice:calculatedParameter"],
        [xml.connection("d.twice -> g.k", '<ssc:LinearTransformation offset="1"/>')],
    )
    results = simulate(path, stop=1.0, step=1.0, parameters={"d.k": 5.0, "g.u": 2.0})
    assert results["g.y"].tolist() == [22.0, 22.0]


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "extrapolated", "iterative"])
def test_a_calculated_parameter_feeds_an_input_at_initialization(pack, xml, algorithm):
    inner = (
        '<ssd:System name="sub">'
        + xml.component("x", "", "o:output").split(">", 1)[1].removesuffix("</ssd:Component>")
        + f"<ssd:Elements>{xml.component('d', 'Derived', 'twice:calculatedParameter')}</ssd:Elements>"
        f"<ssd:Connections>{xml.connection('d.twice -> o')}</ssd:Connections></ssd:System>"
    )
    path = pack(
        ["g Gain u:input y:output", "d Derived twice:calculatedParameter", "h Gain u:input", inner],
        ["d.twice -> g.u", "sub.o -> h.u"],
    )
    results = simulate(path, stop=1.0, step=0.5, algorithm=algorithm, parameters={"d.k": 5.0, "sub.d.k": 3.0})
    assert results["g.y"].tolist() == [20.0, 20.0, 20.0]
    assert results["h.y"].tolist() == [12.0, 12.0, 12.0]
    assert results.summary["notes"] == []


def test_a_unit_of_a_system_connector_is_converted_on_the_way(pack, xml):
    inner = (
        '<ssd:System name="sub"><ssd:Connectors><ssd:Connector name="in" kind="input">'
        '<ssc:Real unit="mm"/></ssd:Connector></ssd:Connectors>'
        f"<ssd:Elements>{xml.component('r', 'Radians', 'm:input')}</ssd:Elements><ssd:Connections>"
        + xml.connection("in -> r.m")
        + "</ssd:Connections></ssd:System>"
    )
    offset = '<ssc:LinearTransformation offset="500"/>'  # in mm, the unit at the end of the first connection
    path = pack([inner, "w Radians y:output"], [xml.connection("w.y -> sub.in", offset)], units=MM)
    # 1 m -> 1000 mm + 500 mm -> 1.5 m; two roundings of the factors 1000 and 0.001.
    np.testing.assert_allclose(simulate(path, stop=1.0, step=1.0, record=["*"])["sub.r.m"], 1.5, rtol=4e-16)


def test_connectors_of_the_outermost_system_fit_what_they_join(pack):
    units = (
        '<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit><ssc:Unit name="kg"><ssc:BaseUnit kg="1"/></ssc:Unit>' + MM
    )
    path = pack(
        ["r Radians m:input:Real:m u:input:Real y:output:Real:m width:parameter:Real:m"],
        ["M -> r.m", "U -> r.u", "r.y -> Y", "W -> r.width"],
        connectors="M:input:Real:kg U:input:String Y:output:Real:mm W:parameter:Real:mm",
        units=units,
    )
    with pytest.raises(SspError) as info:
        check_system(load_ssp(path))
    assert info.value.problems == [
        "connection M -> r.m: unit mismatch, 'kg' (kg) to 'm' (m). "
        "Connect signals of one quantity, or put a component between them",
        f"connection U -> r.u: type mismatch, String to Real. {CONVERT_TYPE}",
    ]
