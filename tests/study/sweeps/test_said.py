"""What a study says of files that are none of its, and of points that all fail."""

import pyarrow
import pytest
from pyarrow import parquet

import vdfmu
from tests.conftest import invoked, refused
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import SspError


def test_faults_of_a_package_name_the_file_of_the_user(tmp_path):
    (tmp_path / "mine.ssp").write_text("no zip file")
    with pytest.raises(SspError, match=r"^mine\.ssp: "):
        vdfmu.sweep(tmp_path / "mine.ssp", {"unit.at": [1.0]}, out=tmp_path / "study")


def test_a_table_of_others_is_no_study(tmp_path):
    file = tmp_path / "sweep.parquet"
    parquet.write_table(pyarrow.table({"point": [0]}), file)
    said = refused("sweep", "report", file)
    assert "sweep.parquet has no facts of a study, so no study of vdfmu wrote it." in said


@pytest.mark.parametrize(("fail", "code"), [((0, 1, 2), 1), ((0, 1), 0)])
def test_the_exit_code_of_a_study_is_1_if_all_points_fail(tmp_path, monkeypatch, fail, code):
    swept = study_of(tmp_path, ["f.x=1, 2, 3"], lambda x: x, fail=fail)
    monkeypatch.setattr("vdfmu.study.sweeps.sweep.sweep", lambda *_, **__: swept)
    done = invoked("sweep", "run", "f.ssp")
    assert done.exit_code == code
    assert "report.html" in done.output
