"""Faults of a system are reported before the run, all at once."""

import re

import pytest

from tests.engine.files import check_file, edited
from vdfmu.base.cache import one_job
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.package.read import load_ssp, read_system
from vdfmu.engine.package_run import run_system
from vdfmu.engine.run import check_system, simulate


def problems(path, **options) -> list[str]:
    with pytest.raises(SspError) as info:
        check_system(load_ssp(path), **options)
    return info.value.problems


def expect(texts: list[str], *patterns: str) -> None:
    """Hold every pattern against one problem each, and the count."""
    for pattern in patterns:
        assert any(re.search(pattern, text) for text in texts), f"{pattern} not in {texts}"
    assert len(texts) == len(patterns), texts


def test_several_faults_at_once(pack, xml):
    c = xml.component
    path = pack(
        ["a Gain u:input y:output nothing:output",
         "b Adder a:input b:input y:output",
         "d Logic bi:input bo:output",
         "deg Degrees y:output mm:output", "rad Radians u:input m:input",
         c("p", "Gain", "u:input", xml.values(xml.real("kk", 1.0) + xml.real("y", 1.0)))],
        ["a.y -> b.a", "b.y -> b.a", "b.y -> d.bi", "a.y -> b.y", "a.y -> nobody.u", "a.z -> b.b",
         "deg.mm -> rad.u", "b.y -> a.u"],
    )  # fmt: skip
    expect(
        problems(path),
        r"a\.nothing: resources/Gain\.fmu has no such variable",
        r"b\.y -> b\.a: duplicate source, b\.a is already fed by a\.y",
        r"b\.y -> d\.bi: type mismatch, Real to Boolean",
        r"a\.y -> b\.y: direction error, it joins output a\.y and output b\.y",
        r"a\.y -> nobody\.u: there is no element 'nobody'",
        r"a\.z -> b\.b: a declares no connector 'z'",
        r"deg\.mm -> rad\.u: unit mismatch, 'mm' \(m\) to 'rad' \(rad\)",
        r"p: parameter 'kk' \(set: kk\): .* has no such variable; did you mean k",
        r"p: parameter 'y' \(set: y\): is not settable: causality output",
        r"algebraic loop in the steps: a\.y -> b\.a -> b\.y -> a\.u -> a\.y",
    )


def test_a_factor_multiplies_the_value_of_the_package_else_the_start_value(pack, xml):
    path = pack([xml.component("p", "Gain", "u:input y:output", xml.values(xml.real("k", 3.0))), "q Gain u:input"], [])
    system = load_ssp(path)
    start = check_system(system).descriptions["q"].variables["k"].start
    for parameters in ({"p.k": "*-0.5", "q.k": "*4"}, {"p.k": "*-.5e0", "q.k": "*4.0"}):
        checked = check_system(system, parameters)
        values = {(name, v.name): value for name, each in checked.starts.items() for v, value in each}
        assert values["p", "k"] == -1.5 and values["q", "k"] == 4.0 * start
    twice = simulate(system, stop=0.1, step=0.1, parameters={"p.k": "*2", "p.u": 1.0})
    assert twice["p.y"][-1] == 6.0  # once, not for each check
    for value, text in (("*x", "expected a number after the star, such as \\*0.8, got \\*x"), ("*", "got \\*")):
        with pytest.raises(UsageError, match=rf"^parameter 'p.k': .*{text}\.$"):
            check_system(system, {"p.k": value})


def test_a_missing_fmu_hides_no_other_fault(pack, xml):
    c = xml.component
    path = pack(
        ["a Nothing u:input y:output", "b Gain u:output", c("d", "Gain", "", xml.values(xml.real("y", 1.0)))],
        ["a.y -> d.u", "d.y -> a.u"],
    )
    system, faults = read_system(path)
    expect(faults, "component 'a': the package has no 'resources/Nothing.fmu'")
    with pytest.raises(SspError) as info:
        check_system(system)
    expect(
        info.value.problems,
        "component 'a': the package has no 'resources/Nothing.fmu'",
        r"b\.u: the SSD declares kind 'output', the FMU causality 'input'",
        r"a\.y -> d\.u: d declares no connector 'u'",
        r"d\.y -> a\.u: d declares no connector 'y'",
        r"d: parameter 'y' .*: is not settable",
    )


def test_loops_of_units_without_declared_dependencies_or_that_must_step_first_are_named(pack):
    path = pack(["a Stock u:input y:output", "b Stock u:input y:output"], ["a.y -> b.u", "b.y -> a.u"])
    loop = r"a\.y -> b\.u -> b\.y -> a\.u -> a\.y\. Note: no dependencies are declared by a, b"
    expect(problems(path, algorithm="gauss-seidel"), loop)
    # the default runs them, and says how
    results = simulate(path, stop=1.0, step=0.25)
    assert results.summary["algorithm"] == "jacobi"
    (note,) = [n for n in results.summary["notes"] if "jacobi" in n]
    assert re.match(rf"the master is jacobi: gauss-seidel, the default, has no order for this system\. .*{loop}", note)
    path = pack(
        ["one Crossed a:input b:input y:output z:output",
         "two Crossed a:input b:input y:output z:output", "source Ramp y:output"],
        ["source.y -> one.a", "one.y -> two.a", "two.y -> one.b"],
    )  # fmt: skip
    expect(problems(path), r"gauss-seidel cannot order one, two: .*one\.y -> two\.a; two\.y -> one\.b\); use jacobi")
    results = simulate(path, stop=4.0, step=1.0, algorithm="jacobi")
    assert results["one.z"].tolist() == [2, 2, 2, 2, 3]


def test_kinds_that_ssp_does_not_connect(pack):
    path = pack(
        ["a Gain y:output", "b Gain u:input k:parameter", "d Gain k:parameter"],
        ["a.y -> b.k", "x -> d.k"],
        connectors="x:input",
    )
    expect(
        problems(path),
        "a.y -> b.k: direction error, it joins output a.y and parameter b.k; "
        "parameter can be fed by calculatedParameter or system parameter",
        "x -> d.k: direction error, it joins system input x and parameter d.k; parameter can be",
    )


def test_unconnected_inputs_are_notes(pack, xml):
    bound = xml.component("b", "Gain", "u:input", xml.values(xml.real("u", 3.0)))
    path = pack(["a Plant u:input y:output", bound], ["a.y -> a.u"])
    seen = []
    results = simulate(path, stop=1.0, step=0.5, log=seen.append)
    note = "a.load: input is not connected and keeps its start value"
    assert results.summary["notes"] == [note]
    assert [(m.status, str(m)) for m in seen] == [("note", note)]
    assert results["b.y"].tolist() == [6.0, 6.0, 6.0]


@pytest.mark.heavy
def test_unmatched_parameters_can_be_ignored(pack, xml):
    path = pack(
        [xml.component("a", "Gain", "", xml.values(xml.real("other", 1.0)))], bindings=xml.values(xml.real("b.k", 1.0))
    )
    out = "; correct the name, or have it ignored: ignore_unmatched, 'vdfmu run --ignore-unmatched'"
    no_other, no_b = "a: parameter 'other' .* has no such variable", "parameter 'b.k' .* matches no element"
    expect(problems(path), f"{no_other}{out}", f"{no_b} or connector{out}")
    notes = check_system(load_ssp(path), ignore_unmatched=True).notes
    expect(
        [note for note in notes if "parameter" in note],
        f"{no_other}; the value is ignored",
        f"{no_b} or connector; the value is ignored",
    )
    with pytest.raises(SspError):
        run_system(path, step=0.5, out=path.parent / "out")
    results = run_system(path, step=0.5, out=path.parent / "out", ignore_unmatched=True)
    assert any("'b.k'" in note for note in results.summary["notes"])
    expect(check_file(path), f"{no_other}{out}", f"{no_b} or connector{out}")  # as a run without the option says


def test_variables_of_one_dotted_name_are_set_together_and_units_that_hardly_differ_the_same(pack, xml, fmus):
    dotted = edited(fmus["Gain"], replace=[(b'name="k"', b'name="C.k"')])
    outer = xml.component("B", "Gain").replace("Gain.fmu", "dotted.fmu")
    path = pack([outer, "B.C Gain"], extra={"resources/dotted.fmu": dotted})
    checked = check_system(load_ssp(path), {"B.C.k": 7.0})
    assert {name: [(v.name, x) for v, x in values] for name, values in checked.starts.items()} == {
        "B": [("C.k", 7.0)],
        "B.C": [("k", 7.0)],
    }
    assert [note for note in checked.notes if "two variables" in note] == [
        "B.C.k: two variables have this name, of B and of B.C; rename a component"
    ]
    units = '<ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="{}"/></ssc:Unit>'
    elements = ["d Degrees y:output:Real:deg", "g Gain u:input:Real:deg"]
    path = pack(elements, ["d.y -> g.u"], units=units.format("0.0174533"))
    (link,) = check_system(load_ssp(path)).links
    assert link.conversion.trivial
    expect(
        problems(pack(elements, ["d.y -> g.u"], units=units.format("0.0174532"))),
        r"d\.y: unit mismatch, the SSD declares 'deg' \(rad, factor 0\.0174532, offset 0\), "
        r"the FMU 'deg' \(rad, factor 0\.017453292519943295, offset 0\)",
    )


def test_an_fmu_that_can_be_there_only_once_and_a_linear_transformation_of_an_integer(pack, xml, fmus):
    old = b'canBeInstantiatedOnlyOncePerProcess="false"'
    data = edited(fmus["Gain"], replace=[(old, old.replace(b"false", b"true"))])
    elements = [xml.component(n, "Gain").replace("Gain.fmu", "once.fmu") for n in ("a", "b")]
    path = pack(elements, extra={"resources/once.fmu": data})
    expect(problems(path), "a, b: resources/once.fmu can be instantiated only once per process")
    twice = '<ssc:LinearTransformation factor="2"/>'
    path = pack(["count Counter n:output", "logic Logic ii:input"], [xml.connection("count.n -> logic.ii", twice)])
    expect(problems(path), "a linear transformation does not apply to Integer")


def test_a_package_that_changes_is_read_again_and_its_descriptions_once(pack):
    with one_job():
        first = load_ssp(pack(["a Ramp y:output"]))
        assert load_ssp(first.path) is first
        assert [*check_system(first).descriptions] == ["a"]
        pack(["b Ramp y:output", "c Gain y:output"])
        assert [c.name for c in load_ssp(first.path).components] == ["b", "c"]
    assert load_ssp(first.path) is not load_ssp(first.path)
    system = load_ssp(pack(["a Ramp y:output"]))
    descriptions = [check_system(system).descriptions["a"] for _ in range(2)]
    assert descriptions[0] is descriptions[1]
    pack(["a Ramp y:output", "b Ramp y:output"])
    assert check_system(system).descriptions["a"] is not descriptions[0]
