"""Results as MATLAB files, and what scipy reads of them; that their bits stay is shown beside Parquet."""

import json
import re

import numpy as np
import pytest
import scipy.io

from tests.engine.files import assert_same_bits, hollow_results
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.engine.run import Results


def test_results_without_rows_or_signals_read_back(tmp_path):
    for some in hollow_results():
        some.write(tmp_path / "r.mat")
        assert_same_bits(Results.read(tmp_path / "r.mat"), some)


def test_names_are_legal_in_matlab_and_units_are_kept(results, tmp_path):
    results.write(tmp_path / "r.mat")
    content = scipy.io.loadmat(tmp_path / "r.mat", squeeze_me=True, struct_as_record=False)
    names = [name for name in content if not name.startswith("__")]
    assert names == ["time", "units", "a_q", "a_q_2", "b____", "end_2", "a_K_p__", "a_on", "b_1_x", "b1_x", "vdfmu"]
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", name, re.ASCII) for name in names)
    np.testing.assert_array_equal(content["a_q"][:, 0], results["a.q[1]"])
    np.testing.assert_array_equal(content["time"], results.time)
    assert content["units"].a_q.tolist() == ["rad", "m"] and content["units"].end_2 == "N.m"
    assert content["a_q_2"].dtype == np.int32
    assert [each[:3:2] for each in json.loads(str(content["vdfmu"]))["signals"]][:2] == [
        ["a.q[1]", "rad"],
        ["a.q[2]", "m"],
    ]


def test_files_of_another_form_and_damaged_ones_are_named(results, tmp_path):
    path = tmp_path / "r.mat"
    results.write(path)
    path.write_bytes(path.read_bytes()[:3000])
    for content in (path.read_bytes(), b"time,a\n", b""):
        path.write_bytes(content)
        with pytest.raises(UsageError, match="r.mat"):
            Results.read(path)
    with pytest.raises(UsageError, match="No such file"):
        Results.read(tmp_path / "none.mat")


def test_a_matlab_file_of_another_tool_and_an_array_beyond_two_gigabytes_are_refused(tmp_path, results, monkeypatch):
    scipy.io.savemat(tmp_path / "r.mat", {"x": np.arange(3.0)})
    with pytest.raises(UsageError, match="expected results that vdfmu wrote, with the variable vdfmu; there are x"):
        Results.read(tmp_path / "r.mat")
    monkeypatch.setattr("vdfmu.extras.matlab.mat_file._MOST", 1000)
    with pytest.raises(VdfmuError, match="a_q: must be at most 2 GB.*--format parquet"):
        results.write(tmp_path / "large.mat")
    assert list(tmp_path.iterdir()) == [tmp_path / "r.mat"]
