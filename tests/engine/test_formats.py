"""A format of results is a file of its own and a row of the registry: commands and runs know it then."""

import pickle
import subprocess
import sys

import pytest

from vdfmu.engine.results.formats import FORMATS
from vdfmu.engine.run import Results, simulate

TOY = """
import pickle, sys
from vdfmu.engine.results.formats import FORMATS, Format

def write(columns, path):
    path.write_bytes(pickle.dumps((columns.time, columns.signals, columns.data, columns.summary)))

def read(path):
    from vdfmu.engine.results.results import Recorded
    return Recorded(*pickle.loads(path.read_bytes()))

FORMATS[".toy"] = lambda: Format(lambda: None, write, read)
"""
RUN = """
from vdfmu.cli.commands import app
app(sys.argv[1:], standalone_mode=False)
"""


@pytest.fixture
def ramp(pack):
    """Return a package of one component."""
    return pack(["r Ramp y:output"], [])


def test_a_new_format_is_one_row_of_the_registry_and_one_that_streams_is_written_beside(ramp, tmp_path, monkeypatch):
    command = [sys.executable, "-c", TOY + RUN, "run", str(ramp), "--step", "0.1", "--stop", "1"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out"), "--format", "csv,toy"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "results.csv, results.toy, summary.json" in done.stdout
    toy = pickle.loads((tmp_path / "out" / "results.toy").read_bytes())
    csv = Results.read(tmp_path / "out" / "results.csv")
    assert Results(*toy)["r.y"].tobytes() == csv["r.y"].tobytes()
    done = subprocess.run([*command, "--format", "tay"], capture_output=True, text=True)
    assert "expected csv, parquet, mat, toy, or csv,parquet,mat,toy for all, got tay." in done.stdout + done.stderr
    monkeypatch.setitem(FORMATS, ".txt", FORMATS[".csv"])
    files = [tmp_path / "rows.txt", tmp_path / "rows.csv"]
    simulate(ramp, step=0.1, stop=1.0, stream=files)
    assert files[0].read_bytes() == files[1].read_bytes() != b""
