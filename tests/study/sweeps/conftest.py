"""A package of one unit that misbehaves at some values of its parameters."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from tests.wild import build, write

WAYS = {"well": 0.0, "crash": 1.0, "leave": 2.0, "hang": 3.0, "refuse": 8.0}
"""Value of the parameter ``way`` of wild.c by what the unit does then at the time ``at``."""
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
    write(folder / "Wild.fmu", build(folder))
    with zipfile.ZipFile(folder / "wild.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SSD)
        archive.write(folder / "Wild.fmu", "resources/Wild.fmu")
    return folder / "wild.ssp"
