"""Units that misbehave when they are told to: the FMUs of ``tests/engine/wild.c`` and ``strict.c``."""

import subprocess
import zipfile
from pathlib import Path

import fmpy

from tests.cc import CC

XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Wild" guid="{{wild {0} {1}}}">
  <CoSimulation modelIdentifier="wild" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"/>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="way" valueReference="100" causality="parameter" variability="fixed"><Real start="{0}"/>
    </ScalarVariable>
    <ScalarVariable name="at" valueReference="101" causality="parameter" variability="fixed"><Real start="{1}"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs>
  <InitialUnknowns><Unknown index="1"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""

STRICT_PARAMETERS = ("end", "nan_from", "inf_from", "refuse", "mute", "discard")
STRICT_XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Strict" guid="{{strict}}">
  <CoSimulation modelIdentifier="strict" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"/>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>{}
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs></ModelStructure>
</fmiModelDescription>"""


def build(folder: Path, name: str = "wild", kind: type | None = None) -> Path:
    """Return the library of a C file of ``tests/engine``; functions that it lacks of a class of fmpy are empty."""
    path = folder / f"{name}{fmpy.sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{headers}"]
    source = Path(__file__).parent / "engine" / f"{name}.c"
    rest = folder / f"{name}_rest.c"
    functions = [each for each in dir(kind) if each.startswith("fmi")]
    rest.write_text("".join(f"__attribute__((weak)) int {each}(void) {{ return 0; }}\n" for each in functions))
    subprocess.run([*CC, *flags, "-o", path, source, rest, "-lm"], check=True)
    return path


def pack(path: Path, library: Path, description: str) -> Path:
    """Write the FMU of a library."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return path


def write(path: Path, library: Path, way: int = 0, at: float = 0.0) -> Path:
    """Write the FMU, with start values of its parameters ``way`` and ``at`` [s]."""
    return pack(path, library, XML.format(way, at))


def write_strict(folder: Path) -> Path:
    """Write the strict FMU, whose y is the time, with parameters for the time [s] of each fault."""
    more = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="parameter" variability="fixed">'
        '<Real start="1e9"/></ScalarVariable>'
        for i, name in enumerate(STRICT_PARAMETERS, start=1)
    )
    return pack(folder / "Strict.fmu", build(folder, "strict"), STRICT_XML.format(more))


BRITTLE_XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Brittle" guid="{brittle}" variableNamingConvention="flat">
  <CoSimulation modelIdentifier="brittle" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
                providesDirectionalDerivative="true"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="x" valueReference="1" causality="output" initial="exact"><Real start="1"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="2" causality="local" initial="calculated"><Real derivative="2"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="2" dependencies=""/></Outputs>
    <Derivatives><Unknown index="3" dependencies="1 2"/></Derivatives>
    <InitialUnknowns><Unknown index="3" dependencies="1 2"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>"""


def write_brittle(folder: Path) -> Path:
    """Write the FMU that crashes or hangs in the call that the environment variable BRITTLE names."""
    return pack(folder / "Brittle.fmu", build(folder, "brittle"), BRITTLE_XML)
