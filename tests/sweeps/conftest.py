"""A package of one unit that misbehaves at some values of its parameters."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import fmpy
import pytest

WAYS = {"well": 0.0, "crash": 1.0, "leave": 2.0, "hang": 3.0, "refuse": 8.0}
"""Value of the parameter ``way`` of wild.c by what the unit does then at the time ``at``."""
XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Wild" guid="{wild 0 0}">
  <CoSimulation modelIdentifier="wild" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="way" valueReference="100" causality="parameter" variability="fixed"><Real start="0"/>
    </ScalarVariable>
    <ScalarVariable name="at" valueReference="101" causality="parameter" variability="fixed"><Real start="0"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs>
  <InitialUnknowns><Unknown index="1"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""
SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
  xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="wild">
  <ssd:System name="system"><ssd:Elements>
    <ssd:Component name="unit" type="application/x-fmu-sharedlibrary" source="resources/Wild.fmu">
      <ssd:Connectors><ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector></ssd:Connectors>
    </ssd:Component>
  </ssd:Elements></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1"/>
</ssd:SystemStructureDescription>"""


@pytest.fixture(scope="session")
def wild(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a package of one unit, ``unit``, with the output y and the parameters ``way`` and ``at`` [s]."""
    folder = tmp_path_factory.mktemp("wild")
    library = folder / f"wild{fmpy.sharedLibraryExtension}"
    source = Path(__file__).parents[1] / "cosim" / "wild.c"
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-std=c11", "-shared", "-fPIC", f"-I{headers}"]
    subprocess.run(["cc", *flags, "-o", library, source, "-lm"], check=True)
    with zipfile.ZipFile(folder / "Wild.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", XML)
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    with zipfile.ZipFile(folder / "wild.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SSD)
        archive.write(folder / "Wild.fmu", "resources/Wild.fmu")
    return folder / "wild.ssp"
