"""How a run over several processes ends before its time: it says who was the reason, keeps the rows, leaves nothing."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import vdfmu
from tests.conftest import heavy
from tests.engine.conftest import make_fmu
from vdfmu.base.errors import CosimError
from vdfmu.engine.federation.federated import Federated
from vdfmu.engine.run import Interrupted

STEP = 0.1


@pytest.fixture
def package(pack):
    return pack(
        ["r Ramp y:output", "f Fragile y:output", "a Adder a:input b:input y:output", "p Plant u:input y:output"],
        ["f.y -> a.a", "p.y -> a.b", "a.y -> p.u"],
        experiment='<ssd:DefaultExperiment startTime="0" stopTime="1"/>',
    )


@pytest.mark.heavy
def test_a_component_that_fails_ends_the_run_with_its_reason_and_the_rows(package, federates):
    with pytest.raises(CosimError, match=r"f failed at t = 0\.5 s in doStep: .*q\[3\] is not finite") as info:
        vdfmu.federate(package, ["f", "p"], step=STEP, parameters={"f.at": 0.5})
    results = info.value.results
    assert results.time.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=1e-15)  # k * 0.1, rounded
    assert set(results.summary["federates"]) == {"f", "p", "r"}
    whole = vdfmu.simulate(package, algorithm="jacobi", step=STEP, stop=0.5)
    assert all(results[name].tobytes() == whole[name].tobytes() for name in whole.names)


@pytest.mark.heavy
@pytest.mark.parametrize("split", [["f", "p"], ["p,r", "a"]], ids="|".join)
def test_a_component_that_fails_in_its_initialization_does_not_leave_the_others_waiting(package, federates, split):
    with pytest.raises(CosimError, match="f failed at t = 0 s in exitInitializationMode: .*no start possible"):
        vdfmu.federate(package, split, step=STEP, parameters={"f.mode": 3})


def run_of(federates: dict[str, object]) -> Federated:
    run = Federated.__new__(Federated)
    run._federates, run._first, run._lock = federates, None, threading.Lock()
    return run


def test_one_that_cannot_join_ends_those_that_would_wait_for_it():
    refused = CosimError("federate b", "exchange", 0.0, "there is no broker")

    class Waiting:
        """Answers when it is cut off."""

        waits = False
        ended = threading.Event()

        def take(self):
            assert self.ended.wait(60.0)
            raise CosimError("federate a", "exchange", 0.0, "its process ended (SIGKILL)")

        def cut(self, late):
            self.ended.set()

    class Refused(Waiting):
        def take(self):
            raise refused

    run = run_of({"a": Waiting(), "b": Refused()})
    with pytest.raises(CosimError) as info:
        run._take(joining=True)
    assert info.value is refused


def test_one_that_ends_after_its_answer_is_the_reason_not_those_that_it_ends():
    reason = CosimError("federate b", "exchange", 0.4, "its process ended (SIGKILL)")

    class Cut:
        waits = False

        def take(self):
            run._ended("b")
            raise CosimError("federate a", "exchange", 0.4, "its process ended (SIGKILL)")

        def cut(self, late):
            assert not late

    class Ended(Cut):
        def take(self):
            """Answer the last request."""

        def lost(self):
            return reason

    run = run_of({"a": Cut(), "b": Ended()})
    with pytest.raises(CosimError) as info:
        run._take()
    assert info.value is reason


@pytest.mark.heavy
@pytest.mark.parametrize("victim", [0, 1])
def test_a_federate_that_is_killed_ends_the_run_with_its_name_and_the_rows(package, federates, victim):
    """Of a federate that a signal kills, between two steps or in one; the first has the broker too."""

    def kill(k: int, n: int) -> None:
        if k == 4:
            os.kill(federates()[victim], signal.SIGKILL)

    name = "rp"[victim]
    with pytest.raises(
        CosimError, match=rf"federate {name}\b.* at t = \S+ s in \S+: its process ended \(SIGKILL\)|federate {name}\)$"
    ) as info:
        vdfmu.federate(package, ["r,a", "p"], step=0.01, progress=kill)
    assert 5 <= len(info.value.results) < 10
    assert info.value.results["r.y"][4] == 4 * 0.01


@pytest.fixture
def bad(tmp_path, pack):
    """Return a function that packs a component that does something bad at t = 0.5 s, and two that read it."""

    def write(code: str):
        step = f"import os, time\nif t > 0.45:\n    {code}"
        fmu = make_fmu(tmp_path, "Bad", "y:output", step)
        return pack(
            ["g Gain u:input y:output", "bad Bad y:output", "p Plant u:input y:output"],
            ["bad.y -> g.u", "g.y -> p.u"],
            extra={"resources/Bad.fmu": fmu.read_bytes()},
        )

    return write


@pytest.mark.parametrize(("code", "reason"), [
    ("os.kill(os.getpid(), 11)", r"the component crashed the process \(SIGSEGV\) \(federate g\)"),
    ("os._exit(3)", r"the component ended the process \(exit code 3\) \(federate g\)"),
    *heavy(("time.sleep(60.0)", r"no return within 6 s; .* \(federate g\)")),
])  # fmt: skip
def test_a_component_that_takes_its_federate_along_is_named_with_it(bad, federates, code, reason):
    """The others wait for it; none is left, and their rows are kept."""
    with pytest.raises(CosimError, match=rf"bad failed at t = 0\.5 s in doStep: {reason}") as info:
        vdfmu.federate(bad(code), ["p", "g,bad"], step=STEP, wait_limit=6.0)  # joining has to take less
    assert len(info.value.results) == 6


@pytest.mark.heavy
def test_ctrl_c_ends_the_run_after_the_step_and_keeps_the_rows(package, federates):
    def press(k: int, n: int) -> None:
        if k == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted, match=r"interrupted at t = 0\.4 s") as info:
        vdfmu.federate(package, ["f", "p"], step=STEP, progress=press)
    assert len(info.value.results) == 5


def command(*arguments: object) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "vdfmu.cli", "run", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, 1)])
def test_the_command_keeps_the_rows_and_leaves_no_process(package, federates, tmp_path, number, code):
    """Of a run of days: Ctrl-C of the command, and the end of a federate."""
    out = tmp_path / "out"
    run = command(package, "--split", "f,p", "--stop", "1e6", "--step", "0.1", "--out", out)
    rows = out / f"partial_{run.pid}" / "results.csv"
    deadline = time.monotonic() + 60.0
    while not (rows.exists() and rows.read_bytes().count(b"\n") > 3):  # names, units and rows, after two seconds
        assert run.poll() is None and time.monotonic() < deadline
        time.sleep(0.1)
    processes = federates(run.pid)
    assert sorted(processes) == [0, 1]
    os.kill(run.pid if number == signal.SIGINT else processes[1], number)
    shown = " ".join(run.communicate(timeout=60)[0].split())
    assert run.returncode == code
    assert f" s are in {out / 'partial' / 'results.csv'}" in shown
    assert "stopped: interrupted at t =" in shown if code == 130 else "federate r" in shown and "SIGKILL" in shown
    kept = vdfmu.Results.read(out / "partial" / "results.csv")
    assert len(kept) > 2 and "p.y" in kept and "r.y" in kept
    assert "federates" in json.loads((out / "partial" / "summary.json").read_text())
    assert not any(os.path.exists(f"/proc/{process}") for process in processes.values())
