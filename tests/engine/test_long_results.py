"""Results of many rows: read block by block, from the same bits, in memory that does not grow with the rows."""

import tracemalloc

import numpy as np
import pytest

from vdfmu.base import csv_file, foreign
from vdfmu.base.errors import StorageError, UsageError
from vdfmu.engine.results import arrays, parquet
from vdfmu.engine.results.results import Results, Signal

ROWS, COLUMNS = 3000, 4


@pytest.fixture
def long(monkeypatch):
    limits = (
        (csv_file, "_CELLS", 1),
        (parquet, "_GROUP", 700),
        (arrays, "_MOST", 20_000),
        (foreign, "_IN_MEMORY", 1000),
    )
    for place, name, value in limits:
        monkeypatch.setattr(place, name, value)
    rng = np.random.default_rng(5)
    signals = [Signal(f"a.x[{i + 1}]", "real", "m", i) for i in range(COLUMNS)]
    signals += [Signal("a.n", "integer", "", 0), Signal("a.on", "boolean", "", 0)]
    data = {
        "real": rng.standard_normal((ROWS, COLUMNS)),
        "integer": rng.integers(-9, 9, (ROWS, 1), dtype=np.int32),
        "boolean": rng.integers(0, 2, (ROWS, 1), dtype=np.int32),
    }
    return Results(1e-3 * np.arange(ROWS), signals, data)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_rows_that_are_read_block_by_block_are_the_same(long, tmp_path, suffix):
    path = tmp_path / f"results.{suffix}"
    long.write(path)
    results = Results.read(path)
    assert all(isinstance(array, np.memmap) for array in results.data.values())
    np.testing.assert_array_equal(results.time, long.time)
    for name in long.names:
        np.testing.assert_array_equal(results[name], long[name], strict=True)


def test_memory_does_not_grow_with_the_rows_and_that_of_a_fault_counts_from_the_first(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "_CELLS", 2**12)
    monkeypatch.setattr(arrays, "_MOST", 2**16)
    peaks = []
    for rows in (5_000, 20_000):
        signals = [Signal(f"a.x[{i + 1}]", "real", "m", i) for i in range(COLUMNS)]
        data = {"real": np.arange(rows * COLUMNS, dtype=float).reshape(rows, COLUMNS)}
        Results(np.arange(rows, dtype=float), signals, data).write(tmp_path / "r.csv")
        tracemalloc.start()
        read = Results.read(tmp_path / "r.csv")
        for block in read.blocks(1000):
            assert block["a.x"].shape == (len(block), COLUMNS)
        peaks.append(tracemalloc.get_traced_memory()[1] - 2 * read.time.nbytes)  # the times: their blocks, and joined
        tracemalloc.stop()
    # what a block takes, not the 15,000 rows more: 32 bytes each, and some 100 as text
    assert peaks[1] - peaks[0] < 0.1 * 15_000 * 32
    monkeypatch.setattr(csv_file, "_CELLS", 1)
    lines = ["time,a", "s,m", *(f"{k},1" for k in range(1500)), "1500,x"]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    with pytest.raises(UsageError, match="row 1503: a: expected a number, got 'x'"):
        Results.read(tmp_path / "r.csv")


def test_a_folder_of_temporary_files_that_is_full_is_named(long, tmp_path, monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    long.write(tmp_path / "r.csv")
    monkeypatch.setattr(arrays.tempfile, "TemporaryFile", full)
    with pytest.raises(StorageError, match=r"r\.csv: cannot write to the temporary folder .*: No space left.*TMPDIR"):
        Results.read(tmp_path / "r.csv")
