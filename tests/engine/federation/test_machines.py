"""Each federate by a command of its own, as on several machines, with the broker of HELICS itself."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

import vdfmu

HELICS = find_spec("helics")  # not imported: see federation/server.py
assert HELICS is not None and HELICS.origin is not None
PROGRAM = Path(HELICS.origin).parent / "install" / "bin" / "helics_broker"


@pytest.fixture
def package(pack, xml):
    c = xml.component
    return pack(
        [
            c("p", "Plant", "u:input load:input y:output", xml.values(xml.real("x0", 1.0))),
            c("g", "Gain", "u:input y:output", xml.values(xml.real("k", -2.0))),
            "f Fragile y:output",
        ],
        ["p.y -> g.u", "g.y -> p.u", "f.y -> p.load"],
    )


@pytest.fixture
def broker():
    """Return the address of a broker for two federates, which ends with them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [PROGRAM, "--federates=2", "--coretype=tcp_ss", f"--port={port}", "--tick=1s", "--loglevel=no_print"]
    )
    yield f"127.0.0.1:{port}"
    process.kill()
    process.wait()


@pytest.fixture
def start(package, broker, tmp_path):
    def command(name: str, *options: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", "vdfmu.cli", "run", package, "--split", "p", "--federate", name, "--broker",
             broker, "--out", tmp_path / name, "--step", "0.1", *options],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    return command


def ends(*runs: subprocess.Popen) -> list[tuple[int, str]]:
    shown = [" ".join(run.communicate(timeout=90)[0].split()) for run in runs]
    return [(run.returncode, text) for run, text in zip(runs, shown, strict=True)]


@pytest.mark.heavy
def test_each_has_the_rows_of_its_components(package, start, tmp_path):
    for code, shown in ends(start("p"), start("g")):
        assert code == 0, shown
    whole = vdfmu.simulate(package, algorithm="jacobi", step=0.1)
    parts = [vdfmu.Results.read(tmp_path / name / "results.csv") for name in "pg"]
    assert sorted(name for part in parts for name in part.names) == sorted(whole.names)
    for part in parts:
        assert part.time.tobytes() == whole.time.tobytes()
        assert all(part[name].tobytes() == whole[name].tobytes() for name in part.names)


@pytest.mark.heavy
def test_a_failure_is_told_to_all(start, tmp_path):
    for code, shown in ends(*(start(name, "--set", "f.at=0.5") for name in "pg")):
        assert code == 1
        assert re.search(r"f failed at t = 0\.5 s in doStep: .*q\[3\] is not finite", shown)
    for name in "pg":
        assert len(vdfmu.Results.read(tmp_path / name / "partial" / "results.csv")) == 6


@pytest.mark.heavy
def test_all_must_run_the_same(start):
    # Another step, of which the first exchange after the first step tells.
    (code_p, shown_p), (code_g, shown_g) = ends(start("p"), start("g", "--step", "0.05"))
    assert (code_p, code_g) == (1, 1)
    for shown in (shown_p, shown_g):
        assert "expected the same package, split, start, stop and step for all" in shown


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("number", "reason"), [(signal.SIGINT, "federate g left the run"), (signal.SIGKILL, "lost comms with federate g")]
)
def test_the_end_of_one_ends_the_other(start, tmp_path, number, reason):
    """Ctrl-C of a command, and its death with all that it has started, which HELICS misses after seconds."""
    runs = start("p", "--stop", "1e6"), start("g", "--stop", "1e6")
    rows = [tmp_path / name / f"partial_{run.pid}" / "results.csv" for name, run in zip("pg", runs, strict=True)]
    deadline = time.monotonic() + 60.0
    while not all(path.exists() and path.read_bytes().count(b"\n") > 3 for path in rows):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.kill(runs[1].pid, number)
    (code, shown), (other, _) = ends(*runs)
    assert (code, other) == (1, 130 if number == signal.SIGINT else -9)
    assert reason in shown
    assert len(vdfmu.Results.read(tmp_path / "p" / "partial" / "results.csv")) > 2
