"""Results as MATLAB and MCAP files: the bits of the CSV, and what scipy, h5py, mcap and rosbags read of them."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
import scipy.io
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from tests.engine.files import assert_same_bits, hard_numbers
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.engine.package_run import run_system
from vdfmu.engine.run import Results, Signal

FORMS = ("mat", "mcap")


@pytest.fixture
def results() -> Results:
    """Return signals of all kinds, with values and names that formats may spoil, and a copy."""
    m = 1300
    real, numbers = hard_numbers(m, 4, 2)
    real[1, 2] = np.inf
    signals = [
        Signal("a.q[1]", "real", "rad", 3),
        Signal("a.q[2]", "real", "m", 1),
        Signal("a.q", "integer", "", 1),
        Signal('b"\u00e4,\n', "real", "", 0),
        Signal("end", "real", "N.m", 2),
        Signal("a.K_p__", "integer", "", 0),
        Signal("a.on", "boolean", "", 0),
        Signal("b_1.x", "real", "m", 0),
        Signal("b1.x", "boolean", "", 0),
        Signal("c.q", "real", "rad", 3, of="a.q[1]"),
    ]
    data = {"real": real, "integer": numbers, "boolean": numbers[:, :1] % 2}
    summary = {"limit": np.inf, "path": "\u00e4", "copies": {"0": {"c.q": "a.q[1]"}}}
    return Results(0.001 * np.arange(m) - 0.5, signals, data, summary)


@pytest.mark.parametrize("form", FORMS)
def test_numbers_of_all_kinds_read_back_to_the_same_bits(results, tmp_path, form):
    path = tmp_path / f"r.{form}"
    results.write(path)
    again = Results.read(path)
    assert_same_bits(again, results)
    assert again.signals[-1].of == "a.q[1]"
    assert again.summary == {**results.summary, "limit": "inf"}
    text = path.read_bytes()
    results.write(path)
    assert path.read_bytes() == text


@pytest.mark.parametrize("form", [*FORMS, "parquet"])
def test_results_without_rows_or_signals_read_back(tmp_path, form):
    empty = Results(np.empty(0), [Signal("a", "real", "m", 0)], {"real": np.empty((0, 1))})
    bare = Results(np.arange(3.0), [], {"real": np.empty((3, 0))})
    for some in (empty, bare):
        some.write(tmp_path / f"r.{form}")
        assert_same_bits(Results.read(tmp_path / f"r.{form}"), some)


def test_a_run_writes_all_forms_alike(arm_package, tmp_path):
    run = run_system(arm_package(), out=tmp_path, formats=("csv", *FORMS), stop=0.05)
    for form in FORMS:
        assert_same_bits(Results.read(tmp_path / f"results.{form}"), run)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {"results.csv", "results.mat", "results.mcap"} < set(summary["files"])


def test_names_are_legal_in_matlab_and_units_are_kept(results, tmp_path):
    results.write(tmp_path / "r.mat")
    found = scipy.io.loadmat(tmp_path / "r.mat", squeeze_me=True, struct_as_record=False)
    names = [name for name in found if not name.startswith("__")]
    assert names == ["time", "units", "a_q", "a_q_2", "b____", "end_2", "a_K_p__", "a_on", "b_1_x", "b1_x", "vdfmu"]
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", name, re.ASCII) for name in names)
    np.testing.assert_array_equal(found["a_q"][:, 0], results["a.q[1]"])
    np.testing.assert_array_equal(found["time"], results.time)
    assert found["units"].a_q.tolist() == ["rad", "m"] and found["units"].end_2 == "N.m"
    assert found["a_q_2"].dtype == np.int32
    assert [each[:3:2] for each in json.loads(str(found["vdfmu"]))["signals"]][:2] == [
        ["a.q[1]", "rad"],
        ["a.q[2]", "m"],
    ]


def test_other_readers_have_the_numbers_of_the_mcap_file(results, tmp_path):
    """The decoder of the MCAP project, and rosbags with definitions from the file, as Foxglove and PlotJuggler do."""
    path = tmp_path / "r.mcap"
    results.write(path)
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        kinds = [s.name for s in reader.get_summary().schemas.values()]
        assert kinds == [f"vdfmu/msg/{name}" for name in ("A", "B", "End", "B1", "B1X")]
        definition = next(s.data.decode() for s in reader.get_summary().schemas.values() if s.name == "vdfmu/msg/A")
        assert "float64[2] q  # rad, m\nint32[1] q_2  # \n" in definition
        decoded = [(m.log_time, d) for _, c, m, d in reader.iter_decoded_messages() if c.topic == "/a"]
    assert [stamp for stamp, _ in decoded[:3]] == [0, 1_000_000, 2_000_000]
    with AnyReader([path]) as reader:
        assert {c.topic for c in reader.connections} == {"/a", "/b", "/end", "/b_1", "/b1"}
        one = [c for c in reader.connections if c.topic == "/a"]
        others = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(one)]
    for mine in ([d for _, d in decoded], others):
        for name, column in (("q", [results["a.q[1]"], results["a.q[2]"]]), ("k_p", [results["a.K_p__"]])):
            np.testing.assert_array_equal(np.array([getattr(d, name) for d in mine]).T, column)
        np.testing.assert_array_equal([d.time for d in mine], results.time)
        np.testing.assert_array_equal([bool(d.on[0]) for d in mine], results["a.on"])


@pytest.mark.parametrize("form", FORMS)
def test_files_of_another_form_and_damaged_ones_are_named(results, tmp_path, form):
    path = tmp_path / f"r.{form}"
    results.write(path)
    path.write_bytes(path.read_bytes()[:3000])
    for content in (path.read_bytes(), b"time,a\n", b""):
        path.write_bytes(content)
        with pytest.raises(UsageError, match=f"r.{form}"):
            Results.read(path)
    with pytest.raises(UsageError, match="No such file"):
        Results.read(tmp_path / f"none.{form}")


def test_a_byte_that_changed_in_an_mcap_file_is_found(results, tmp_path):
    path = tmp_path / "r.mcap"
    results.write(path)
    text = bytearray(path.read_bytes())
    for place in range(500, 20_000, 2000):  # in the chunk of the messages, behind which lies their index
        path.write_bytes(text[:place] + bytes([text[place] ^ 1]) + text[place + 1 :])
        with pytest.raises(UsageError, match="cannot read"):
            Results.read(path)


def test_a_matlab_file_of_another_tool_is_no_file_of_results(tmp_path):
    scipy.io.savemat(tmp_path / "r.mat", {"x": np.arange(3.0)})
    with pytest.raises(UsageError, match="expected results that vdfmu wrote, with the variable vdfmu; there are x"):
        Results.read(tmp_path / "r.mat")


def test_an_array_beyond_two_gigabytes_is_refused(results, tmp_path, monkeypatch):
    monkeypatch.setattr("vdfmu.engine.results.mat_file._MOST", 1000)
    with pytest.raises(VdfmuError, match="a_q: expected at most 2 GB.*--format parquet"):
        results.write(tmp_path / "r.mat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.heavy
def test_without_mcap_the_command_says_how_to_get_it(arm_package, tmp_path):
    code = "import sys; sys.modules['mcap'] = None; import vdfmu.cli; vdfmu.cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "simulate", str(arm_package()), "--format", "mcap", "--out", str(tmp_path / "o")],
        check=False, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    said = " ".join(done.stderr.split())
    assert done.returncode == 2 and "MCAP needs the package mcap" in said and "'pip install vdfmu[mcap]'" in said
    assert not (tmp_path / "o").exists()
