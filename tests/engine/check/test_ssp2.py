"""`vdfmu check` on systems of SSP 2.0 and on several SSDs in a package."""

from functools import partial

import pytest

from tests.engine import texts
from tests.engine.texts import connection, connections, elements, ssd
from vdfmu.base.files import pack_zip
from vdfmu.engine.inspect.inspection import inspect_file

values = partial(texts.values, version="2.0")
parameter = partial(texts.parameter, kind="Float64")


def connector(name, kind, size=2, of="Float64"):
    dimension = f'<ssc:Dimension size="{size}"/>' if size else ""
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:{of}/>{dimension}</ssd:Connector>'


def component(name, *connectors, inner=""):
    box = f"<ssd:Connectors>{''.join(connectors)}</ssd:Connectors>" if connectors else ""
    return texts.component(name, f"resources/{name}.fmu", box + inner)


def system(*components, links="", before="", units=""):
    units = f"<ssd:Units>{units}</ssd:Units>" if units else ""
    return ssd(before + elements(*components) + links, units, version="2.0")


GOOD = system(
    component("Trajectory", connector("q_d", "output"), connector("q_d_dot", "output")),
    component("PDController", connector("q_d", "input"), connector("q_d_dot", "input"), connector("q", "input")),
    component("Plant", connector("q", "output")),
    links=connections(
        "Trajectory.q_d PDController.q_d", "Trajectory.q_d_dot PDController.q_d_dot", "Plant.q PDController.q"
    ),
)


@pytest.fixture
def package(fmus_3, tmp_path):
    def write(text, extra=None):
        path = tmp_path / "x.ssp"
        units = {f"resources/{p.name}": p.read_bytes() for p in fmus_3.values() if p.stem in text}
        pack_zip(path, {"SystemStructure.ssd": text.encode(), **units, **(extra or {})})
        return path

    return write


def test_all_faults_of_connectors_and_connections_come_at_once(package):
    text = system(
        component("Trajectory", connector("q_d", "output", 3), connector("q_d_dot", "input"), connector("x", "output")),
        component("PDController", connector("q_d", "input", 0), connector("q_d_dot", "input", of="Int32")),
        component("Plant", connector("q", "output"), connector("E_kin", "output", 0)),
        links=connections(
            "Plant.E_kin PDController.q_d", "Plant.q PDController.q_d", "Plant.q PDController.nothing",
            "Plant.q Nobody.q",
        ),
    )  # fmt: skip
    assert inspect_file(package(text), run=False).problems == [
        "connection Plant.q -> PDController.q_d: duplicate source, PDController.q_d is already fed by Plant.E_kin",
        "connection Plant.q -> PDController.nothing: PDController declares no connector 'nothing'",
        "connection Plant.q -> Nobody.q: there is no element 'Nobody'",
        "Trajectory.q_d: the SSD declares an array of 3, the FMU an array of 2",
        "Trajectory.q_d_dot: the SSD declares kind 'input', the FMU causality 'output'",
        "Trajectory.x: resources/Trajectory.fmu has no such variable",
        "PDController.q_d: the SSD declares a scalar, the FMU an array of 2",
        "PDController.q_d_dot: the SSD declares type Int32, the FMU Float64",
        "connection Plant.E_kin -> PDController.q_d: unit mismatch, 'J' (kg.m2/s2) to 'rad' (rad). "
        "Connect signals of one quantity, or put a component between them",
        "connection Plant.E_kin -> PDController.q_d: dimension mismatch, a scalar to an array of 2",
    ]


@pytest.mark.parametrize(("name", "value", "unit", "fault"), [
    ("tolerance", "0.1", "", ""),
    ("tolerance", "1", "", "expected at most 0.1, got 1"),
    ("tolerance", "20", "percent", "expected at most 0.1, got 0.2"),
    ("tolerance", "5", "percent", ""),
    ("q_dot_0", "1e300 -1e300", "", ""),  # no limits
    ("mass", "1 -1", "", "expected a number above 0, got -1 kg"),
])  # fmt: skip
def test_values_lie_within_the_limits_of_the_fmu(package, name, value, unit, fault):
    size = len(value.split())
    inner = values(parameter(name, value, unit=unit, size=size if size > 1 else 0))
    text = system(
        component("Plant", inner=inner), units='<ssc:Unit name="percent"><ssc:BaseUnit factor="0.01"/></ssc:Unit>'
    )
    where = f"Plant: parameter {name!r} (p: {name}): "
    assert inspect_file(package(text), run=False).problems == ([where + fault] if fault else [])


def test_kinds_of_connectors_that_only_ssp_2_has_can_be_connected(package):
    text = system(
        component("Plant", connector("q", "constant")),
        component("PDController", connector("ell", "structuralParameter"), connector("q", "input")),
        links=connections("Plant.q PDController.ell", "Plant.q PDController.q"),
    )
    assert not any("direction error" in p for p in inspect_file(package(text), run=False).problems)


def test_every_variant_of_a_package_is_checked(package):
    other = GOOD.replace('endElement="PDController" endConnector="q"', 'endElement="PDController" endConnector="w"')
    report = inspect_file(package(GOOD, {"VarB.ssd": other.encode()}), run=False)
    assert report.problems == ["VarB.ssd: connection Plant.q -> PDController.w: PDController declares no connector 'w'"]
    (problem,) = inspect_file(package(other.replace('size="2"', 'size="x"', 1)), run=False).problems
    assert "'x' is not a valid value" in problem  # faults of the schema are the only ones


def test_indices_choose_elements_and_must_lie_in_the_array(package):
    def linked(start, end, plant="E_kin"):
        size = 0 if plant == "E_kin" else 2
        items = [
            connection(f"Plant.{plant} PDController.q_d", attributes=f'suppressUnitConversion="true" {a} {b}')
            for a, b in zip(start, end, strict=True)
        ]
        text = system(
            component("Plant", connector(plant, "output", size)),
            component("PDController", connector("q_d", "input")),
            links=f"<ssd:Connections>{''.join(items)}</ssd:Connections>",
        )
        return inspect_file(package(text), run=False).problems

    # one scalar feeds both elements
    assert linked(["", ""], ['endIndices="1"', 'endIndices="2"']) == []
    assert linked(['startIndices="2"'], ['endIndices="1"'], "q") == []
    name = "connection Plant.E_kin -> PDController.q_d: "
    (problem,) = linked(["", ""], ['endIndices="1"', 'endIndices="1"'])
    assert problem.startswith(f"{name}duplicate source")
    (problem,) = linked(["", ""], ['endIndices="1"', ""])[:1]
    assert problem.startswith(f"{name}duplicate source")
    for index in ("0", "3"):
        assert linked([""], [f'endIndices="{index}"']) == [
            f"{name}endIndices: {index} is outside of PDController.q_d, an array of 2; the first index is 1"
        ]
    assert linked([""], ['endIndices="1 1"']) == [f"{name}endIndices: 2 for PDController.q_d, an array of 2"]
