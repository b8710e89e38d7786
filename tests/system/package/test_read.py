"""Reading of packages that are broken or mean harm."""

import pytest

from tests.engine.texts import binding, component, connections, connector_list, elements, ssd, values
from tests.system.package.problems import problems, write
from vdfmu.engine.package import archive
from vdfmu.engine.package.read import load_ssp, read_system


@pytest.mark.parametrize(("limit", "value", "sizes", "expected"), [
    ("MEMBER_LIMIT", 1000, [1000, 1001], "entry '1' has 1001 bytes; the limit is 1000"),
    ("TOTAL_LIMIT", 1500, [1000, 1000], "the limit is 1500"),
    ("COUNT_LIMIT", 10, [0] * 10, "has 11 entries; the limit is 10"),
    ("DIRECTORY_LIMIT", 205, [0, 0, 0], "has a directory of 206 bytes; the limit is 205. Pack fewer files"),
])  # fmt: skip
def test_what_is_large_is_refused(tmp_path, monkeypatch, limit, value, sizes, expected):
    monkeypatch.setattr(archive, limit, value)
    (fault,) = problems(write(tmp_path / "x.ssp", ssd(), {str(k): bytes(size) for k, size in enumerate(sizes)}))
    assert fault.startswith("x.ssp: ") and expected in fault


def test_a_faulty_package_is_read_as_far_as_it_goes(tmp_path):
    """With all faults in one pass: of the parameter set, of its mapping, of the FMUs, of the wiring."""
    end = "</ssd:ParameterBindings>"
    second = f'<ssd:ParameterBinding source="p.ssv" sourceBase="component"/>{end}'
    bindings = binding("none.ssv", "none.ssm").replace(end, second)
    inside = elements(component("a", "there.fmu"), component("b", "missing.fmu", bindings))
    path = write(tmp_path / "x.ssp", ssd(inside + connections("a.y c.u")), {"there.fmu": b""})
    system, faults = read_system(path)
    assert faults == problems(path)
    assert faults == [
        "x.ssp: component 'b': the package has no 'missing.fmu'",
        "x.ssp: the package has no 'none.ssv'",
        "x.ssp: the package has no 'none.ssm'",
    ]
    assert [(c.name, c.source) for c in system.components] == [("a", "there.fmu"), ("b", "")]
    assert system.problems == (
        *faults,
        "connection a.y -> c.u: a declares no connector 'y'",
        "connection a.y -> c.u: there is no element 'c'",
    )
    write(tmp_path / "y.ssp", ssd("<ssd:System>"))
    assert read_system(tmp_path / "y.ssp")[0] is None
    assert "not well-formed" in read_system(tmp_path / "y.ssp")[1][0]


def test_an_inline_parameter_set_is_validated_and_default_experiment_and_units_read(tmp_path):
    path = write(tmp_path / "x.ssp", ssd(elements(component(inner=values("k=big")))), {"a.fmu": b""})
    assert "'big' is not a valid value of the atomic type 'xs:double'" in problems(path)[0]
    rest = (
        '<ssd:Units><ssc:Unit name="N.m"><ssc:BaseUnit kg="1" m="2" s="-2"/></ssc:Unit></ssd:Units>'
        '<ssd:DefaultExperiment startTime="0.5" stopTime="2"/>'
    )
    loaded = load_ssp(write(tmp_path / "x.ssp", ssd(elements(component()), rest), {"a.fmu": b""}))
    assert (loaded.experiment.start, loaded.experiment.stop) == (0.5, 2.0)
    assert loaded.units["N.m"].dimension == "kg.m2/s2"
    assert [c.name for c in loaded.components] == ["a"]


def test_connectors_that_feed_each_other_in_a_ring_end(tmp_path):
    through = connector_list("i:input o:output") + connections("i o")
    systems = elements(*(f'<ssd:System name="{name}">{through}</ssd:System>' for name in "pq"))
    path = write(tmp_path / "x.ssp", ssd(systems + connections("p.o q.i", "q.o p.i")))
    assert load_ssp(path).connections == ()
