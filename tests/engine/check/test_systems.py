"""`vdfmu check` on systems, and as JSON."""

import io
import json

import pytest

from tests.engine.files import check_file, members
from tests.warm import command
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import StorageError
from vdfmu.base.files import pack_zip
from vdfmu.engine.inspect.fmu import NOT_RUN
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("planar_tracking")


@pytest.fixture(scope="module")
def fmus(scenario, tmp_path_factory):
    values = system_values(scenario)
    return build_fmus(scenario.robot, tmp_path_factory.mktemp("fmus"), parameters=values, backend="python", folded=True)


@pytest.fixture(scope="module")
def package(scenario, fmus, tmp_path_factory):
    return write_ssp(scenario, fmus, tmp_path_factory.mktemp("ssp") / "planar.ssp")


def test_a_system_with_a_faulty_fmu_is_not_run(package, tmp_path):
    content = members(package)
    name = next(n for n in content if n.endswith("Plant.fmu"))
    inner = members(io.BytesIO(content[name]))
    text = inner["modelDescription.xml"].replace(b'unit="rad/s"', b'unit="rad/h"')
    pack_zip(tmp_path / "Plant.fmu", inner | {"modelDescription.xml": text})
    pack_zip(tmp_path / "x.ssp", content | {name: (tmp_path / "Plant.fmu").read_bytes()})
    report = inspect_file(tmp_path / "x.ssp")
    assert any('The unit "rad/h" of variable ' in problem for problem in report.problems)
    assert not report.ran
    assert report.notes[-1] == NOT_RUN


@pytest.mark.heavy
def test_a_system_is_checked_as_package_and_as_folder(package, tmp_path):
    assert check_file(package) == []
    for name, data in members(package).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(data)
    ssd = tmp_path / "SystemStructure.ssd"
    assert check_file(ssd) == []
    ssd.write_bytes(ssd.read_bytes().replace(b'startConnector="q[1]"', b'startConnector="qq[1]"'))
    problems = check_file(ssd)
    assert len(problems) == 2 and all("plant declares no connector 'qq[1]'" in p for p in problems)
    ssd.write_bytes(ssd.read_bytes().replace(b"<ssd:Elements>", b"\n<ssd:Elemente>"))
    (tmp_path / "arm.ssd").write_bytes(ssd.read_bytes())
    for name in ("SystemStructure.ssd", "arm.ssd"):  # by the names of files that exist
        assert all(p.startswith(f"{name}: is not well-formed XML") for p in check_file(tmp_path / name))


@pytest.mark.heavy
def test_the_command_prints_json_and_ends_with_code_1_for_problems(package, tmp_path):
    def run(path):
        return command("check", path, "--json")

    good = run(package)
    assert good.returncode == 0
    said = json.loads(good.stdout)
    assert list(said) == ["format", "file", "kind", "standard", "ran", "compared", "problems", "notes", "findings"]
    assert said | {"notes": [], "compared": []} == {
        "format": 1, "file": str(package), "kind": "SSP", "standard": "SSP 1.0", "ran": True, "compared": [],
        "problems": [], "notes": [], "findings": [],
    }  # fmt: skip
    assert said["notes"] == []
    (tmp_path / "no.ssp").write_bytes(b"no zip")
    bad = run(tmp_path / "no.ssp")
    assert bad.returncode == 1
    assert len(json.loads(bad.stdout)["problems"]) == 1


def test_an_fmu_of_a_long_name_is_stored_under_another(package, tmp_path):
    content, name = members(package), f"resources/{'P' * 300}.fmu"
    content[name] = content.pop("resources/Plant.fmu")
    ssd = content["SystemStructure.ssd"].replace(b"resources/Plant.fmu", name.encode())
    pack_zip(tmp_path / "long.ssp", content | {"SystemStructure.ssd": ssd})
    assert check_file(tmp_path / "long.ssp", run=False) == []


def test_a_temporary_folder_that_cannot_be_written_is_told(package, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(StorageError, match="was not checked: .*TMPDIR"):
        check_file(package)
