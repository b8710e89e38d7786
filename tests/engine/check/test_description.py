"""Rules of a model description: several faults at once, and rules that fmpy does not know."""

import zipfile

import pytest

from vdfmu.engine.inspect.inspection import inspect_file

HEAD = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="1"><CoSimulation modelIdentifier="m">{sources}
</CoSimulation><UnitDefinitions><Unit name="rad"/><Unit name="m"/></UnitDefinitions>
<TypeDefinitions><SimpleType name="Angle"><Real unit="rad" max="1"/></SimpleType></TypeDefinitions>
<ModelVariables>
"""
TAIL = """</ModelVariables>
<ModelStructure><Outputs><Unknown index="2" dependencies="{of}"/></Outputs><InitialUnknowns><Unknown index="2"/>
</InitialUnknowns></ModelStructure></fmiModelDescription>"""
INPUT = '<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>\n'
OUTPUT = '<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>\n'


def local(name, reference, inner, attributes=""):
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}>{inner}</ScalarVariable>\n'


@pytest.fixture
def problems(tmp_path):
    def say(*variables, of="1", sources="", members=None, text=None, notes=False):
        default = HEAD.format(sources=sources) + INPUT + OUTPUT + "".join(variables) + TAIL.format(of=of)
        with zipfile.ZipFile(tmp_path / "m.fmu", "w") as file:
            file.writestr("modelDescription.xml", text or default)
            for name, content in (members or {}).items():
                file.writestr(name, content)
        report = inspect_file(tmp_path / "m.fmu", run=False)
        if notes:
            return report.notes
        return [p for p in report.problems if not p.startswith("no binary for this platform")]

    return say


def test_references_that_lead_nowhere_hide_no_other_fault(problems):
    assert problems(local("a", 3, '<Real declaredType="Angle" start="0.5"/>', 'initial="exact"')) == []
    faults = problems(
        local("u", 3, '<Real unit="furlong" displayUnit="mile"/>'), local("d", 4, '<Real derivative="99"/>'),
        local("t", 5, '<Real declaredType="None"/>'), local("p", 6, '<Real start="0"/>', 'causality="parameter"'),
        local("s", 7, '<Real displayUnit="deg"/>'), of="1 42",
    )  # fmt: skip
    where = "modelDescription.xml, line"
    assert faults == [
        f"{where} 8: variable 'd': derivative='99': expected the index of a variable, from 1 to 7",
        f"{where} 9: variable 't': declaredType 'None' is not defined; define it in TypeDefinitions",
        f"{where} 10: variable 'p': causality 'parameter' and variability 'continuous' (default) do not "
        "go together; expected fixed or tunable",
        f"{where} 11: variable 's': has the display unit 'deg' and no unit; state the unit",
        f"{where} 13: Unknown: dependencies: 42: expected the index of a variable, from 1 to 7",
        'The variable name "u" (line 7) is not unique.',
        'The unit "furlong" of variable "u" (line 7) is not defined.',
    ]


ALIAS = """<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="1">
<CoSimulation modelIdentifier="m"/><ModelVariables>
<Float64 name="time" valueReference="0" causality="independent"><Alias name="t"/></Float64>
<Float64 name="y" valueReference="1" causality="output"><Alias name="{name}"/></Float64></ModelVariables>
<ModelStructure><Output valueReference="1" dependencies="{of}"/><InitialUnknown valueReference="1"/></ModelStructure>
</fmiModelDescription>"""


def test_an_alias_needs_no_entry_and_is_a_name_of_its_own(problems):
    assert problems(text=ALIAS.format(name="z", of="")) == []
    assert problems(text=ALIAS.format(name="time", of="7")) == [
        "modelDescription.xml, line 5: Output: dependencies: 7: no variable has that value reference",
        'The variable name "time" (line 4) is not unique.',
    ]


def test_a_library_for_another_processor_or_none_is_named_and_not_loaded(problems, tmp_path):
    import fmpy

    head = bytearray(b"\x7fELF\x02\x01" + bytes(58))
    head[18] = 183 if fmpy.architecture != "aarch64" else 62
    name = f"binaries/{fmpy.platform}/m{fmpy.sharedLibraryExtension}"
    if not name.endswith(".so"):
        pytest.skip("the head of this test is one of Linux")
    (problem,) = problems(members={name: bytes(head)})
    assert problem.startswith(f"{name}: is compiled for ") and "this platform needs" in problem
    assert problems(of="42")
    report = inspect_file(tmp_path / "m.fmu", run=False)
    assert any(p.startswith("no binary for this platform") for p in report.problems)


NAMES = {
    "q": True, "_a9": True, "plant.q[1]": True, "R_O[1,2]": True, "a[1].b[2].c": True, "der(q[1])": True,
    "der(a.b,2)": True, "'any thing'.x": True, "9a": False, "a b": False, "a..b": False,
    "a[]": False, "a[1": False, "der(der(q))": False, "q[1]x": False, "\u00e4": False, "a[\u0661]": False,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_structured_names_are_judged_as_by_the_grammar(problems, name):
    """Plain names are not read by fmpy's parser, which takes milliseconds for each."""
    head = HEAD.format(sources="").replace('guid="1"', 'guid="1" variableNamingConvention="structured"')
    added = local(name, 3, '<Real start="0"/>', 'initial="exact"')
    faults = problems(text=head + INPUT + OUTPUT + added + TAIL.format(of="1"))
    assert any("is not a legal variable name" in text for text in faults) != NAMES[name]
