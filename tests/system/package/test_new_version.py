"""A version of FMI and one of SSP that are made up are a row each, and go all the way into FMU and package."""

import json
import zipfile
from xml.etree import ElementTree

from vdfmu.base.standards import FMI_2, FMI_VERSIONS, SSP_1, SSP_FORMATS
from vdfmu.engine.package.read import load_ssp
from vdfmu.system.package.write import build_parts, fmi_of_format, write_ssp
from vdfmu.system.scenario import load_scenario

UNIT = """from vdfmu.unit import Input, Output, Unit

class Doubled(Unit):
    \"\"\"Twice the input.\"\"\"

    u = Input("1", (2,), "input")
    y = Output("1", (2,), "twice the input")

    def outputs(self) -> None:
        self.y = 2.0 * self.u
"""
SCENARIO = 'name = "mine"\nsystem = "mine.sys.toml"\nstop = 0.1\nstep = 0.01\n'


def test_a_version_is_a_row(tmp_path, monkeypatch):
    fmi = FMI_2._replace(name="2.7", picture=False, build_description=True)
    ssp = SSP_1._replace(name="1.7", fmi=fmi, schemas=("none", ""), always_validated=False)
    monkeypatch.setitem(FMI_VERSIONS, fmi.name, fmi)
    monkeypatch.setitem(SSP_FORMATS, ssp.name, ssp)
    (tmp_path / "doubled.py").write_text(UNIT)
    (tmp_path / "mine.sys.toml").write_text('name = "mine"\n[components]\nplant = "doubled.py"\n')
    (tmp_path / "mine.toml").write_text(SCENARIO)
    scenario = load_scenario(tmp_path / "mine.toml")
    assert fmi_of_format(ssp.name, "native") == fmi.name

    fmus = build_parts(scenario, tmp_path, backend="native", fmi_version=fmi.name)
    with zipfile.ZipFile(fmus["plant"]) as unit:
        names = set(unit.namelist())
        assert ElementTree.fromstring(unit.read("modelDescription.xml")).get("fmiVersion") == fmi.name
        assert json.loads(unit.read("extra/vdfmu/vdfmu.json"))["fmi_version"] == fmi.name
        assert f"FMI {fmi.name}" in unit.read("documentation/index.html").decode()
    assert {"sources/fmi2.c", "sources/buildDescription.xml"} <= names
    assert names.isdisjoint({"sources/fmi3.c", "model.png"})

    package = write_ssp(scenario, fmus, tmp_path / "mine.ssp", version=ssp.name)
    with zipfile.ZipFile(package) as system:
        structure = ElementTree.fromstring(system.read("SystemStructure.ssd"))
    assert structure.get("version") == load_ssp(package).version == ssp.name
