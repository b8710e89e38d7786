"""Reading of packages that are broken or mean harm."""

import zipfile

import pytest

from tests.engine.texts import binding, component, connections, connector_list, elements, ssd, values
from tests.system.package.problems import problems, write
from vdfmu.engine.package import limits
from vdfmu.engine.package.read import load_ssp, read_system

OUTSIDE = "is not a relative path inside the package; put the file into the package and name it by its path there"


@pytest.mark.parametrize("name", ["../evil.fmu", "/etc/evil", "a/../../evil", "C:/evil", "a\\..\\evil"])
def test_entries_outside_the_package_are_refused(tmp_path, name):
    faults = problems(write(tmp_path / "x.ssp", ssd(), {name: b"x", "fine": b"y"}))
    assert len(faults) == 1
    assert "points outside the package" in faults[0]
    assert list(tmp_path.iterdir()) == [tmp_path / "x.ssp"]


@pytest.mark.parametrize(("limit", "value", "sizes", "expected"), [
    ("MEMBER_LIMIT", 1000, [1000, 1001], "entry '1' has 1001 bytes; the limit is 1000"),
    ("TOTAL_LIMIT", 1500, [1000, 1000], "the limit is 1500"),
    ("COUNT_LIMIT", 10, [0] * 10, "has 11 entries; the limit is 10"),
    ("DIRECTORY_LIMIT", 205, [0, 0, 0], "has a directory of 206 bytes; the limit is 205. Pack fewer files"),
])  # fmt: skip
def test_what_is_large_is_refused(tmp_path, monkeypatch, limit, value, sizes, expected):
    monkeypatch.setattr(limits, limit, value)
    (fault,) = problems(write(tmp_path / "x.ssp", ssd(), {str(k): bytes(size) for k, size in enumerate(sizes)}))
    assert fault.startswith("x.ssp: ") and expected in fault


def test_a_file_that_is_no_package_and_a_damaged_member(tmp_path):
    (tmp_path / "x.ssp").write_bytes(b"hello")
    assert "cannot be read as a zip package" in problems(tmp_path / "x.ssp")[0]
    assert problems(tmp_path / "missing.ssp") == [
        "missing.ssp: there is no such file. Give another path, or write it by 'vdfmu ssp'"
    ]
    with zipfile.ZipFile(tmp_path / "y.ssp", "w") as file:
        file.writestr("other", "")
    assert problems(tmp_path / "y.ssp") == ["y.ssp: the package has no 'SystemStructure.ssd'"]
    path = write(tmp_path / "x.ssp", ssd(elements(component(inner="<!-- " + "long " * 500 + " -->"))))
    data = bytearray(path.read_bytes())
    data[80:100] = bytes(20)
    path.write_bytes(bytes(data))
    assert "SystemStructure.ssd" in problems(path)[0]


def test_faults_of_schema_version_and_syntax_have_their_line(tmp_path):
    path = write(tmp_path / "x.ssp", ssd(elements("\n<ssd:Component/>")))
    faults = problems(path)
    assert all(text.startswith("x.ssp: SystemStructure.ssd, line 2") for text in faults)
    assert {"name", "source"} <= {word for text in faults for word in text.split("'")}
    path = write(tmp_path / "x.ssp", ssd().replace("SSP1", "SSP2"))
    assert "expected namespace http://ssp-standard.org/SSP1" in problems(path)[0]
    assert "not well-formed" in problems(write(tmp_path / "x.ssp", ssd("<ssd:System>")))[0]


def test_missing_resources_and_bad_sources_at_once(tmp_path):
    inside = elements(
        component("a", "there.fmu", binding("none.ssv")),
        component("b", "../out.fmu"),
        component("c", "http://localhost/x.fmu"),
        component("d", "x.mo", attributes='type="text/x-modelica"'),
        component("e", "missing.fmu"),
        '<ssd:SignalDictionaryReference name="f" dictionary="none"/>',
    )
    faults = problems(write(tmp_path / "x.ssp", ssd(inside), {"there.fmu": b""}))
    assert faults == [
        f"x.ssp: component 'b': source '../out.fmu' {OUTSIDE}",
        f"x.ssp: component 'c': source 'http://localhost/x.fmu' {OUTSIDE}",
        "x.ssp: component 'd': type 'text/x-modelica' is not supported; expected "
        "application/x-fmu-sharedlibrary, application/x-ssp-package or application/x-ssp-definition",
        "x.ssp: component 'e': the package has no 'missing.fmu'",
        "x.ssp: 'f' refers to signal dictionary 'none', but the SSD lacks it",
        "x.ssp: the package has no 'none.ssv'",
    ]


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
