"""FMUs without their C: ``vdfmu build --no-sources``."""

import zipfile

import fmpy
import pytest
from fmpy.validation import validate_fmu

from tests.compiler.fmu.gain import UNIT
from tests.compiler.unit.conftest import command
from tests.conftest import heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_member


@pytest.mark.parametrize("version", [*heavy("2.0"), "3.0"])
def test_an_fmu_without_sources_runs_and_has_no_c_in_it(tmp_path, monkeypatch, version):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gain.py").write_text(UNIT)
    done = command("build", "gain.py", "--fmi", version, "--no-sources")
    assert done.exit_code == 0, done.output
    fmu = tmp_path / "fmus" / "Gain.fmu"
    with zipfile.ZipFile(fmu) as archive:
        assert not [name for name in archive.namelist() if name.startswith("sources/") or name.endswith((".c", ".h"))]
        texts = [archive.read(f"documentation/{name}").decode() for name in ("index.html", "licenses/license.txt")]
    assert not any("sources/" in text for text in texts)
    assert b"SourceFiles" not in (read_member(fmu, "modelDescription.xml") or b"")
    assert validate_fmu(str(fmu)) == []
    result = fmpy.simulate_fmu(str(fmu), stop_time=0.1, output_interval=0.1, start_values={"u": 1.5})
    assert result["y"][-1] == 3.0
    assert command("check", str(fmu)).exit_code == 0
    (again,) = build_fmus(None, tmp_path / "fmus", units=["gain.py"], fmi_version=version).values()
    with zipfile.ZipFile(again) as archive:  # is another FMU, and replaced
        assert "sources/unit.c" in archive.namelist()


def test_a_python_fmu_is_its_source(tmp_path):
    (tmp_path / "gain.py").write_text(UNIT)
    with pytest.raises(UsageError, match="Gain: a Python FMU contains its source"):
        build_fmus(None, tmp_path, units=[tmp_path / "gain.py"], backend="python", sources=False)
