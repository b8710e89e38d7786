"""``vdfmu verify``: an FMU is built again and compared to the bit."""

import json
import zipfile

import pytest

import vdfmu
from tests.compiler.fmu.test_about import UNIT
from tests.compiler.fmu.test_native_content import members
from tests.compiler.unit.conftest import command
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.files import pack_zip
from vdfmu.compiler.fmu.build import verify

INSIDE = "extra/vdfmu/vdfmu.json"


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("verify")
    (folder / "gain.py").write_text(UNIT)
    robot = vdfmu.load_robot("planar_2dof")
    native = vdfmu.build_fmus(
        robot, folder, units=["controller", folder / "gain.py"], backend="native", fmi_version="3.0",
        start_values={"controller": {"K_p[1]": 123.0}},
    )  # fmt: skip
    python = vdfmu.build_fmus(None, folder / "python", units=[folder / "gain.py"], backend="python")
    return {"folder": folder, "python": python["gain"], **native}


@pytest.mark.heavy
def test_fmus_are_the_same_as_built_again(fmus):
    assert verify(fmus["controller"]) == []
    for name in ("gain", "python"):
        done = command("verify", str(fmus[name]), "--unit", str(fmus["folder"] / "gain.py"))
        assert done.exit_code == 0 and "the same to the bit" in done.output


@pytest.mark.heavy
def test_each_changed_file_is_named(fmus, tmp_path):
    found = members(fmus["controller"])
    library = next(name for name in found if name.endswith(".so"))
    changed = dict(found)
    changed[library] = found[library][:-1] + bytes([found[library][-1] ^ 1])
    changed["resources/more.txt"] = b"more"
    del changed["documentation/index.html"]
    pack_zip(tmp_path / "changed.fmu", changed)
    first, second, third = verify(tmp_path / "changed.fmu")
    assert first.startswith(f"{library}: differs")
    assert second == "documentation/index.html: is missing"
    assert third == "resources/more.txt: is not in an FMU of these sources"
    done = command("verify", str(tmp_path / "changed.fmu"))
    assert done.exit_code == 1 and "not the same" in done.output


def test_what_cannot_be_compared_is_refused(fmus, tmp_path):
    for name in ("gain", "python"):  # that which a Python FMU carries is not run
        with pytest.raises(UsageError, match=r"its unit gain is a file of a user's own.* --unit my_unit\.py"):
            verify(fmus[name])
    found = members(fmus["controller"])
    data = json.loads(found[INSIDE])
    for key in ("digest", "tool"):
        pack_zip(tmp_path / "other.fmu", found | {INSIDE: json.dumps(data | {key: "another"}).encode()})
        with pytest.raises(FmuError, match="only the same make the same bits"):
            verify(tmp_path / "other.fmu")
    pack_zip(tmp_path / "none.fmu", {"modelDescription.xml": found["modelDescription.xml"]})
    with pytest.raises(FmuError, match="not an FMU of a unit that vdfmu built"):
        verify(tmp_path / "none.fmu")
    pack_zip(tmp_path / "production.fmu", found | {"eFMU/__content.xml": b""})
    with pytest.raises(FmuError, match="an eFMU; only plain FMUs are built again"):
        verify(tmp_path / "production.fmu")
    with zipfile.ZipFile(tmp_path / "twice.fmu", "w") as archive:
        for name in ("modelDescription.xml", INSIDE):
            archive.writestr(name, found[name])
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr(INSIDE, b"{}")
    with pytest.raises(FmuError, match="it has a file twice"):
        verify(tmp_path / "twice.fmu")
    (tmp_path / "text.fmu").write_text("no zip")
    with pytest.raises(FmuError, match="cannot be read as an FMU"):
        verify(tmp_path / "text.fmu")
    with pytest.raises(UsageError, match="there is no such file"):
        verify(tmp_path / "missing.fmu")
