"""Rows that go to a file as they come: the same numbers, in memory that does not grow, and kept by what fails."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.engine.files import assert_same_bits
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results import recorder
from vdfmu.engine.results.recorder import ROWS, Recorder
from vdfmu.engine.run import Results, Signal, simulate


def cells(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_streamed_results_are_those_in_memory(package, tmp_path):
    options = {"stop": 2.0 * ROWS * 1e-3 + 0.1}  # two blocks and a part of one
    memory = simulate(package, **options)
    stream = simulate(package, stream=tmp_path / "rows.csv", **options)
    memory.write(tmp_path / "memory.csv")
    written, whole = (cells(tmp_path / name) for name in ("rows.csv", "memory.csv"))
    assert written == whole
    assert stream.names == memory.names
    assert_same_bits(stream, memory)
    thin, few = stream.thinned(200), memory.thinned(200)
    assert len(thin) == len(few) == 188  # every sixth of 1125
    np.testing.assert_array_equal(thin["plant.q[1]"], memory["plant.q[1]"][::6])
    np.testing.assert_array_equal(few.time, memory.time[::6])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["memory.csv", "rows.csv"]


def test_a_large_file_of_text_is_announced_before_its_rows(package, tmp_path, monkeypatch, caplog):
    files = [tmp_path / "results.csv", tmp_path / "results.parquet"]
    simulate(package, stream=files, stop=2.0)
    assert not caplog.messages
    size = files[0].stat().st_size
    monkeypatch.setattr(recorder, "_LARGE", size // 2)
    simulate(package, stream=files[1], stop=2.0)  # is not text
    assert not caplog.messages
    monkeypatch.setattr(Recorder, "keep", lambda self, k: pytest.fail(f"row {k}") if not caplog.messages else None)
    simulate(package, stream=files, stop=2.0)
    (message,) = caplog.messages
    said = re.fullmatch(r"results.csv will be about (\S+) GB \(\d+ signals at 2001 times\). (.*)", message)
    # numbers have 1 digit where they are whole and 24 characters at most: about 20 is right to a factor of two
    assert said and 0.5 * size < 1e9 * float(said[1]) < 2.0 * size
    assert said[2] == "--format parquet takes about a third of that; --record writes fewer signals."


def make(path: Path, columns: int) -> tuple[Recorder, np.ndarray]:
    block = np.zeros((ROWS, columns))
    signals = [Signal(f"a.y[{i + 1}]", "real", "", i) for i in range(columns)]

    def put(i: int) -> None:
        block[i] = np.arange(columns) + 0.125 * i

    return Recorder([path], signals, {"real": block}, {}, put, np.arange), block


def test_a_row_is_in_the_file_after_two_seconds(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(recorder.clock, "perf_counter", lambda: now[0])
    writer, _ = make(tmp_path / "rows.csv", 1)
    for k, now[0] in enumerate((0.0, 1.0, 2.1)):
        writer.keep(k)
    assert (tmp_path / "rows.csv").read_text() == "time,a.y[1]\ns,\n0,0\n1,1.25E-1\n"


def test_a_file_that_cannot_be_opened_is_named(package, tmp_path):
    with pytest.raises(VdfmuError, match=r"nowhere/rows\.csv: the rows cannot be written: No such file"):
        simulate(package, stop=0.01, stream=tmp_path / "nowhere" / "rows.csv")


@pytest.mark.few(1)
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
def test_recorded_are_the_outputs_and_inputs_on_request(package, tmp_path, algorithm):
    """An input that is held has the value of its source in this row or in the row before."""
    options = {"stop": 0.05, "algorithm": algorithm}
    outputs = simulate(package, stream=tmp_path / "results.csv", **options)
    whole = simulate(package, record=["*"], **options)
    assert cells(tmp_path / "results.csv")[0][1:] == outputs.names
    inputs = set(whole.names) - set(outputs.names)
    assert {"plant.tau[1]", "controller.q[2]", "feedforward.q[2]"} < inputs
    assert not {name for name in outputs.names if name.startswith(("plant.tau[", "controller.q"))}
    for name in outputs.names:
        np.testing.assert_array_equal(whole[name], outputs[name])
    held = whole.summary["held"]
    if algorithm in ("extrapolated", "iterative"):  # inputs run on within a step
        assert held == []
        return
    assert {"controller.q", "feedforward.q"} < set(held)
    assert ("plant.tau" in held) == (algorithm == "jacobi")
    for name, source in (("controller.q", "plant.q"), ("plant.tau", "controller.tau")):
        of = whole[source]
        np.testing.assert_array_equal(whole[name], np.r_[of[:1], of[:-1]] if name in held else of)


def test_the_signals_that_are_named_are_written_and_inputs_can_be_replayed(package, tmp_path):
    simulate(package, stop=0.01, record=["plant.tau[*]", "controller.q[1]"], stream=tmp_path / "rows.csv")
    head = (tmp_path / "rows.csv").read_text().partition("\n")[0]
    assert head == "time,controller.q[1],plant.tau[1],plant.tau[2]"
    out = tmp_path / "results.csv"
    run = simulate(package, stop=0.05, stream=out, record=["plant.tau[*]", "controller.*"])
    (table,) = read_inputs(out)
    for name in ("plant.tau[2]", "controller.kappa_dot[1]"):
        np.testing.assert_array_equal(table.values[:, table.names.index(name)], run[name])
        assert table.units[table.names.index(name)] == run.units[name]
    inputs = {"plant.F_e[1]": (np.array([0.0, 0.05]), np.array([0.0, 5.0]))}
    run = simulate(package, stop=0.05, inputs=inputs)
    assert run["plant.F_e[1]"][-1] == pytest.approx(4.9, rel=1e-12) and "plant.F_e[2]" not in run


@pytest.mark.parametrize("files", [["results.csv"], ["other.csv"], "results.csv", 7, None])
def test_a_csv_file_has_the_summary_that_names_it(package, tmp_path, files):
    rows = tmp_path / "results.csv"
    facts = simulate(package, stop=0.05, stream=rows).summary | {"files": files}
    (tmp_path / "summary.json").write_text(json.dumps(facts))
    assert Results.read(rows).summary == (facts if files == ["results.csv"] else {})
