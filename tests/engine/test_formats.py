"""A format of results is a file of its own and a row of the registry: commands and runs know it then."""

import pickle

import pytest

from tests.conftest import ran, refused
from vdfmu.engine.results.formats import FORMATS, Format
from vdfmu.engine.results.results import Recorded
from vdfmu.engine.run import Results, simulate


@pytest.fixture
def ramp(pack):
    """Return a package of one component."""
    return pack(["r Ramp y:output"], [])


def test_a_new_format_is_one_row_of_the_registry_and_one_that_streams_is_written_beside(ramp, tmp_path, monkeypatch):
    def write(columns, path):
        path.write_bytes(pickle.dumps((columns.time, columns.signals, columns.data, columns.summary)))

    def read(path):
        return Recorded(*pickle.loads(path.read_bytes()))

    monkeypatch.setitem(FORMATS, ".toy", lambda: Format(lambda: None, write, read))
    options = ["run", ramp, "--step", "0.1", "--stop", "1"]
    done = ran(*options, "--out", tmp_path / "out", "--format", "csv,toy")
    assert "results.csv, results.toy, summary.json" in done.stdout
    toy, csv = (Results.read(tmp_path / "out" / f"results.{form}") for form in ("toy", "csv"))
    assert toy["r.y"].tobytes() == csv["r.y"].tobytes()
    names = [suffix[1:] for suffix in FORMATS]
    assert names[:2] == ["csv", "parquet"] and names[-1] == "toy"
    expected = f"expected {', '.join(names)}, or {','.join(names)} for all, got tay."
    assert expected in refused(*options, "--format", "tay")
    monkeypatch.setitem(FORMATS, ".txt", FORMATS[".csv"])
    files = [tmp_path / "rows.txt", tmp_path / "rows.csv"]
    simulate(ramp, step=0.1, stop=1.0, stream=files)
    assert files[0].read_bytes() == files[1].read_bytes() != b""
