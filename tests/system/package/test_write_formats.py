"""The files of both versions of SSP by the schemas of another package, libcosim, and what is refused."""

import re
import zipfile
from xml.etree import ElementTree

import pytest
from pyssp_standard.ssd import SSD
from pyssp_standard.ssm import SSM
from pyssp_standard.ssv import SSV

from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import PAGE_MARK
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.package.parse import to_bytes
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.structure_file import mapping_file, parameter_file, structure_file, system_page
from vdfmu.system.package.write import build_parts, fmi_of_format, write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.fixture(scope="module")
def fmus_3(scenario, tmp_path_factory):
    return build_parts(scenario, tmp_path_factory.mktemp("fmus"), fmi_version="3.0")


@pytest.mark.heavy
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", ["estimation", "slider_tracking", "tracking", "two_joint"])
def test_every_file_is_valid_for_another_reader(name, version, tmp_path):
    description = SystemDescription(load_scenario(name), version=version)
    files = {"SystemStructure.ssd": (SSD, structure_file(description))}
    for file, parameters in description.parameter_sets.items():
        files[file] = (SSV, parameter_file(parameters, version))
    (binding,) = [b for b in description.bindings["plant"] if b.mapping]
    files["plant.ssm"] = (SSM, mapping_file(binding.mapping, version))
    for file, (reader, root) in files.items():
        path = tmp_path / file
        path.write_bytes(to_bytes(root))
        with reader(path, mode="r") as read:
            assert read.identifier.startswith(file[-3:] + ("2" if version == "2.0" else ""))
            read.__check_compliance__()  # raises if it is not valid


def test_a_package_of_ssp_2_holds_arrays(scenario, fmus_3, tmp_path):
    path = write_ssp(scenario, fmus_3, tmp_path / "system.ssp", version="2.0")
    assert path.read_bytes() == write_ssp(scenario, fmus_3, tmp_path / "b.ssp", version="2.0").read_bytes()
    with zipfile.ZipFile(path) as archive:
        ssd = archive.read("SystemStructure.ssd").decode()
        ssv = archive.read("resources/controller.scenario.ssv").decode()
        variables = {unit: _variables(archive.open(f"resources/{fmu.name}")) for unit, fmu in fmus_3.items()}
    assert re.search(r'name="tau_m" kind="input".*?<ssc:Float64 unit="N.m"/>\s*<ssc:Dimension size="2"/>', ssd, re.S)
    assert re.search(r'name="K_p">\s*<ssv:Float64 value="(\S+) (\S+)" unit="N.m/rad"/>\s*<ssc:Dim', ssv)
    root = ElementTree.fromstring(ssd)
    spaces = {
        "d": "http://ssp-standard.org/SSP1/SystemStructureDescription",
        "c": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    }
    for component in root.iterfind(".//d:Component", spaces):
        for connector in component.iterfind("d:Connectors/d:Connector", spaces):
            shape = tuple(int(d.get("size")) for d in connector.iterfind("c:Dimension", spaces))
            assert variables[component.get("name")][connector.get("name")] == shape


def _variables(stream):
    with zipfile.ZipFile(stream) as fmu:
        model = ElementTree.fromstring(fmu.read("modelDescription.xml"))
    return {
        v.get("name"): tuple(int(d.get("start")) for d in v.iterfind("Dimension")) for v in model.find("ModelVariables")
    }


def test_the_wrong_fmus_are_refused(scenario, fmus, fmus_3, tmp_path):
    with pytest.raises(UsageError, match=r"SSP 2.0 holds units of FMI 3.0, got Trajectory.fmu of FMI 2.0"):
        write_ssp(scenario, fmus, tmp_path / "x.ssp", version="2.0")
    with pytest.raises(UsageError, match=r"SSP 1.0 holds units of FMI 2.0, got Trajectory.fmu of FMI 3.0"):
        write_ssp(scenario, fmus_3, tmp_path / "x.ssp")
    with pytest.raises(UsageError, match=r"There is no SSP '1.1' here. There are: '1.0', '2.0'"):
        write_ssp(scenario, fmus, tmp_path / "x.ssp", version="1.1")
    with pytest.raises(StorageError, match=r"plant: .*none.fmu is missing or no FMU"):
        write_ssp(scenario, {**fmus, "plant": tmp_path / "none.fmu"}, tmp_path / "x.ssp")
    assert not list(tmp_path.iterdir())


def test_impossible_formats_say_what_to_do(monkeypatch):
    assert [fmi_of_format(form, None) for form in ("1.0", "2.0")] == ["2.0", "3.0"]
    with pytest.raises(UsageError, match=r"There is no SSP '3.0' here. There are: '1.0', '2.0'"):
        fmi_of_format("3.0", None)
    with pytest.raises(UsageError, match=r"Python FMUs have FMI 2.0. Omit --backend python"):
        fmi_of_format("2.0", "python")
    monkeypatch.setattr("vdfmu.system.package.write.native_available", lambda: False)
    with pytest.raises(UsageError, match=r"compiler is not installed. Install it \(pip install vdfmu\[native\]\)"):
        fmi_of_format("2.0", None)


def test_the_page_shows_the_system(scenario):
    description = SystemDescription(scenario)
    page = system_page(description, {}, ["2.0"]).decode()
    root = ElementTree.fromstring(
        page.replace("<!DOCTYPE html>", "")
        .replace('<meta charset="utf-8">', "")
        .replace('<meta name="viewport" content="width=device-width">', "")
        .replace(re.search("<meta http-equiv.*>\n", page)[0], "")
        .replace(PAGE_MARK.decode(), "")
        .replace("<br>", "")
    )  # the rest is well-formed
    wires = root.findall(".//{http://www.w3.org/2000/svg}g")
    starts = {f"{unit}.{signal.group}" for unit, signal in (link.start for link in description.links)}
    assert sorted(str(wire.get("data-signal")) for wire in wires) == sorted(starts)  # one for each vector
    cells = ["".join(cell.itertext()) for cell in root.iter("td")]
    for unit, values in system_values(scenario).items():
        for name, value in values.items():
            if Interface(shipped_units()[unit], scenario.robot).find(name).type == "Real":
                assert repr(float(value)) in cells, (unit, name)
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "")  # needs no network
