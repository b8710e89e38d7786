"""A package of one unit that misbehaves at some values of its parameters."""

import zipfile

import numpy as np
import pytest

import vdfmu
from tests.wild import build, write
from vdfmu.study.sweeps.axes import draw, read_axes
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.sweep import Sweep

WAYS = {"well": 0.0, "crash": 1.0, "leave": 2.0, "hang": 3.0, "refuse": 8.0}
"""Value of the parameter ``way`` of wild.c by what the unit does then at the time ``at``."""
MEASURES = ["end=final(unit.y)", "count=integral(unit.y)"]
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


def table(swept: Sweep) -> dict[str, list]:
    """Return all columns but the times that points took, as lists: NaN equals itself in them."""
    columns = swept.table().drop_columns(["wall_s"]).to_pydict()
    return {name: ["nan" if x != x else x for x in column] for name, column in columns.items()}


@pytest.fixture(scope="session")
def wild(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wild")
    write(folder / "Wild.fmu", build(folder))
    with zipfile.ZipFile(folder / "wild.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SSD)
        archive.write(folder / "Wild.fmu", "resources/Wild.fmu")
    return folder / "wild.ssp"


def study(wild, out, **options):
    """Run 40 points of a unit that never fails, in chunks of 4."""
    options = {"workers": 2, "chunk": 4, "measure": MEASURES, "step": 0.01, **options}
    return vdfmu.sweep(wild, {"unit.at": np.linspace(0.0, 1.0, 40)}, out=out, **options)


@pytest.fixture(scope="module")
def undisturbed(wild, tmp_path_factory):
    return table(study(wild, tmp_path_factory.mktemp("undisturbed") / "study"))


def study_of(folder, over, function, sample="grid", n=None, fail=()):
    """Write a study of a function of the parameters, as runs would leave it."""
    axes, points = draw(read_axes(over), sample, n)
    values = function(*points.values())
    facts = {
        "vdfmu": "0", "scenario": "f", "source": "f", "axes": [str(axis) for axis in axes], "sample": sample,
        "n": len(values), "seed": 0, "parameters": {}, "options": {}, "systems": [],
        "measures": {"y": "final(f.y)"},
        "units": {"y": "rad", **{axis.target: "kg" for axis in axes}},
    }  # fmt: skip
    rows = [
        {"point": k, "failed": "it broke" if k in fail else None, "failed_at": None, "wall_s": 0.1}
        | ({} if k in fail else {"y": float(y)})
        for k, y in enumerate(values)
    ]
    with Ledger(folder, facts, "key", points) as ledger:
        for first in range(0, len(rows), 50):
            ledger.add(rows[first : first + 50])
        return Sweep(ledger.finish())
