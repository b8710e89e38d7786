"""Components that end, crash or never return: in a process of their own the run says who, and keeps its rows."""

import gc
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.conftest import heavy
from tests.engine.files import assert_same_bits
from tests.wild import build, write
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.interrupt import listening
from vdfmu.base.process import KEPT, SHOWN
from vdfmu.engine.inspect import trial as check_run
from vdfmu.engine.run import Interrupted, simulate

WAYS = (
    "crash", "leave", "hang", "eat", "crash_free", "error_end", "fatal_end", "strange", "negative", "error_free",
    "leave_early", "hang_end", "strange_end",
)  # fmt: skip


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("wild"))


@pytest.fixture
def wild(library, tmp_path):
    """Return a function that makes the FMU, wild in a way from a time on by itself."""

    def make(way: str = "", at: float = 0.0) -> Path:
        return write(tmp_path / f"Wild{way}.fmu", library, WAYS.index(way) + 1 if way else 0, at)

    return make


@pytest.fixture
def alone(pack, wild):
    return lambda *how: pack(["unit W y:output"], extra={"resources/W.fmu": wild(*how).read_bytes()})


@pytest.fixture
def package(pack, wild):
    return pack(
        ["plant Plant u:input y:output", "unit Wild y:output"],
        ["unit.y -> plant.u"],
        extra={"resources/Wild.fmu": wild().read_bytes()},
        experiment='<ssd:DefaultExperiment startTime="0" stopTime="1"/>',
    )


def fails(package: Path, way: str, **options) -> CosimError:
    with pytest.raises(CosimError) as info:
        simulate(package, step=0.25, parameters={"unit.way": WAYS.index(way) + 1, "unit.at": 0.5}, **options)
    return info.value


@pytest.mark.parametrize(("way", "options", "said"), [
    ("crash", {}, r"the component crashed the process \(SIGSEGV\)"),
    *heavy(("leave", {}, r"the component ended the process \(exit code 0\)")),
    *heavy(("hang", {"wait_limit": 5.0}, r"no return within 5 s; a longer wait_limit \(run --wait-limit\)")),
    *heavy(("eat", {"memory_limit": 400.0}, r"SIGSEGV\); its memory had reached \d+ MB of 400 MB")),
    *heavy(("strange", {}, r"the unit gave no reason \(status 17, not of FMI 2\.0\)")),
    *heavy(("negative", {}, r"the unit gave no reason \(status -1, not of FMI 2\.0\)")),
])  # fmt: skip
def test_what_ends_a_step_names_component_call_and_time_and_keeps_the_rows(package, way, options, said):
    error = fails(package, way, **options)
    assert (error.unit, error.call, error.time) == ("unit", "doStep", 0.5)
    assert error.results.time.tolist() == error.results["unit.y"].tolist() == [0.0, 0.25, 0.5]
    assert re.search(said, str(error))


@pytest.mark.heavy
def test_an_adaptive_step_or_a_start_that_ends_the_process_has_its_own_time(package):
    error = fails(package, "leave", algorithm="extrapolated", adaptive=1e-4)
    assert (error.unit, error.call) == ("unit", "doStep")
    # the step in which it ended began at 0.5 s or later, between two rows
    assert 0.5 <= error.time < 0.75
    assert error.results.time.tolist() == [0.0, 0.25, 0.5]
    error = fails(package, "leave_early")
    assert str(error) == (
        "unit failed at t = 0 s in exitInitializationMode: the component ended the process (exit code 3)"
    )
    assert error.results is None


def children() -> set[str]:
    """Return the processes that this one has started, which other tests may have left."""
    return set(Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split())


@pytest.mark.heavy
def test_this_process_outlives_them(package):
    """Nothing is left of a process: neither it, nor its threads, nor its files."""
    fails(package, "crash")
    gc.collect()
    descriptors, before = len(os.listdir("/proc/self/fd")), children()
    for way in ("crash", "leave") * 3:
        fails(package, way)
        simulate(package, step=0.25)
    gc.collect()  # the error holds the frames of its run
    assert len(os.listdir("/proc/self/fd")) == descriptors
    assert children() <= before


@pytest.mark.few(1)
@pytest.mark.parametrize(("way", "call", "said", "options"), [
    *((*end, {"isolate": isolate}) for isolate in (False, True) for end in (
        ("error_end", "terminate", r"the brake does not close \(status error\)"),
        ("fatal_end", "terminate", r"the unit gave no reason.* \(status fatal\)"),
        ("strange_end", "terminate", r"status 17, not of FMI 2\.0\)"),
        ("error_free", "freeInstance", "the file is still open"),
    )),
    ("crash_free", "freeInstance", "crashed the process", {}),
    *heavy(("hang_end", "terminate", "no return within 5 s", {"wait_limit": 5.0})),
])  # fmt: skip
def test_what_fails_after_the_last_step_is_said_and_costs_no_row(package, way, call, said, options):
    error = fails(package, way, **options)
    assert (error.unit, error.call, error.time) == ("unit", call, 1.0)
    assert error.results["unit.y"].tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert re.search(said, str(error))


@pytest.mark.heavy
@pytest.mark.parametrize("way", ["error_end", "strange", "error_free", "fatal_end", "strange_end", "negative"])
@pytest.mark.parametrize("kind", ["FMU", "SSP"])
def test_check_says_what_a_unit_returns_that_it_may_not(wild, alone, way, kind):
    path = wild(way, 0.5e-3) if kind == "FMU" else alone(way, 0.5e-3)
    (problem,) = check_run.run_apart(path, kind).problems
    assert problem.startswith("10 steps of 0.")


@pytest.mark.parametrize(
    ("way", "call"), [*heavy(("crash", "doStep"), ("leave", "doStep")), ("crash_free", "freeInstance")]
)
def test_check_of_a_package_names_the_component_that_ends_the_process(wild, alone, way, call):
    (problem,) = check_run.run_apart(alone(way, 0.5e-3), "SSP").problems
    assert re.search(rf"unit failed at t = \S+ s in {call}: ", problem)
    assert "ed the process (" in problem


@pytest.mark.heavy
@pytest.mark.parametrize(("way", "call"), [("hang", "doStep"), ("hang_end", "terminate")])
def test_check_of_a_package_names_the_component_that_does_not_return(wild, alone, monkeypatch, way, call):
    monkeypatch.setattr(check_run, "SECONDS", check_run.NAMING + 8.0)  # 8 s for the start of Python and the run
    (problem,) = check_run.run_apart(alone(way, 0.5e-3), "SSP").problems
    # a second is the least time that a call has, also where a busy machine took longer to start
    assert re.search(rf"unit failed at t = 0\.\d+ s in {call}: no return within [1-8](\.\d)? s; ", problem), problem


@pytest.fixture
def silent(tmp_path, monkeypatch):
    """Have each instance start a process whose heart beats every 20 ms; return what says whether all have stopped."""
    beats = tmp_path / "beats"
    monkeypatch.setenv("BEATS", str(beats))

    def stopped() -> bool:
        count = beats.stat().st_size
        time.sleep(1.0)
        return count > 0 and beats.stat().st_size == count

    stopped.file = beats
    return stopped


@pytest.mark.parametrize(
    ("way", "options"),
    [("crash", {}), *heavy(("", {}), ("leave", {}), ("hang", {"wait_limit": 5.0}), ("eat", {"memory_limit": 400.0}))],
)
def test_processes_of_a_component_end_with_the_run(package, silent, way, options):
    if way:
        fails(package, way, **options)
    else:
        simulate(package, step=0.25, isolate=True)
    assert silent()


@pytest.mark.parametrize("kind", ["FMU", *heavy("SSP")])
@pytest.mark.parametrize("way", ["crash", *heavy("", "hang")])
def test_processes_of_a_component_end_with_the_check(wild, alone, silent, monkeypatch, kind, way):
    path = (wild if kind == "FMU" else alone)(way)
    for seconds in (8.0, 60.0):  # on a busy machine the instance may not have been made after the first
        monkeypatch.setattr(check_run, "SECONDS", seconds)
        problems = check_run.run_apart(path, kind).problems
        if silent.file.exists():
            break
    assert bool(problems) == bool(way)
    assert silent()


@pytest.mark.heavy
@pytest.mark.parametrize("kind", ["FMU", "SSP"])
def test_processes_of_a_component_end_with_a_check_that_is_stopped(wild, alone, silent, kind):
    path = (wild if kind == "FMU" else alone)("hang")
    check = subprocess.Popen([sys.executable, "-m", "vdfmu.cli", "check", path])
    while not silent.file.exists() and check.poll() is None:
        time.sleep(0.05)
    check.send_signal(signal.SIGINT)
    assert check.wait(60.0) == 130
    assert silent()


def test_what_a_component_prints_is_shown_and_not_executed_and_its_last_words_too(package, monkeypatch, capsys):
    monkeypatch.setenv("WORDS", "\x1b[2J\x1b]0;owned\x07 \xe9")
    simulate(package, step=0.25)
    said = capsys.readouterr()
    assert said.err == 4 * "\\x1b[2J\\x1b]0;owned\\x07 \xe9\n"
    assert said.out == ""
    monkeypatch.setenv("WORDS", "assertion failed: \x1b[31mq > 0")
    fails(package, "crash")
    assert capsys.readouterr().err.endswith("assertion failed: \\x1b[31mq > 0\n")


def test_a_flood_of_a_component_is_shown_in_part_and_holds_nothing_up(package, monkeypatch, capsys):
    """Far more than a pipe holds, 64 KiB: the first `SHOWN` bytes and the last `KEPT`."""
    monkeypatch.setenv("WORDS", 99_999 * "x")
    results = simulate(package, step=1.0 / 64.0)
    assert len(results) == 65
    said = capsys.readouterr().err
    left_out = 64 * 100_000 - SHOWN - KEPT
    assert f"\n... ({left_out} bytes left out)\n" in said
    assert len(said) < SHOWN + KEPT + 100  # the sentence between them


@pytest.mark.heavy
@pytest.mark.parametrize("algorithm", ["iterative", "gauss-seidel", "jacobi", "extrapolated"])
def test_isolated_components_compute_the_same_bits(arm_package, algorithm):
    here, apart = (
        simulate(arm_package(), algorithm=algorithm, stop=0.02, isolate=isolate) for isolate in (False, True)
    )
    assert not here.summary["isolated"]
    assert apart.summary["isolated"]
    assert here.names == apart.names
    assert_same_bits(apart, here)


@pytest.mark.heavy
def test_only_foreign_components_are_isolated_by_default(package, arm_package):
    for backend in ("native", "python"):
        assert not simulate(arm_package(backend), stop=0.002).summary["isolated"]
    assert simulate(package, step=0.25).summary["isolated"]


def test_ctrl_c_keeps_the_rows_of_another_process_and_ends_a_step_that_hangs(package):
    pressed = []

    def press(k: int, n: int) -> None:
        if k == 2:
            pressed.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

    hang = {"unit.way": WAYS.index("hang") + 1, "unit.at": 0.5}
    with pytest.raises(Interrupted) as info:
        simulate(package, step=0.25, parameters=hang, progress=press)
    took = time.monotonic() - pressed[0]
    assert info.value.results.time.tolist() == [0.0, 0.25, 0.5]
    assert took < 10.0  # half a second, and a busy machine; the time limit is 300 s


@pytest.mark.parametrize(
    "options", [{"wait_limit": 0.0}, {"memory_limit": -1.0}, *({"wait_limit": float(x)} for x in ("nan", "inf"))]
)
def test_limits_must_be_positive(package, options):
    with pytest.raises(UsageError, match=f"{next(iter(options))} must be (a )?positive"):
        simulate(package, step=0.25, **options)


def test_a_component_that_ends_the_process_of_the_master_is_named_and_the_rows_are_kept(package, tmp_path):
    """It calls C's exit, of which Python learns nothing."""
    (tmp_path / "tmp").mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", "run", package, "--step", "0.25", "--set", "unit.way=2",
         "--set", "unit.at=0.5", "--no-isolate", "--out", tmp_path / "out"],
        capture_output=True, text=True, timeout=300, check=False, env=os.environ | {"TMPDIR": str(tmp_path / "tmp")},
    )  # fmt: skip
    (rows,) = (tmp_path / "out").glob("partial_*/results.csv")
    assert done.returncode == 1
    assert done.stderr == f"error: component unit ended the process at t = 0.5 s. The rows so far are in {rows}.\n"
    assert len(rows.read_text().splitlines()) == 2 + 3
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.heavy
def test_after_a_run_the_process_may_end_as_it_likes_and_after_steps_by_hand_that_is_reported(package):
    for code, end in (
        ("for _ in range(3): simulate(sys.argv[1], step=0.25, isolate=False)\n", (5, "")),
        ("loaded = Simulator(sys.argv[1], isolate=False).__enter__()\nloaded.reset(step=0.25)\nloaded.step(4)\n",
         (1, "error: a component ended the process at t = 0.75 s.\n")),
    ):  # fmt: skip
        code = f"import ctypes, sys\nfrom vdfmu.engine.run import Simulator, simulate\n{code}ctypes.CDLL(None).exit(5)"
        done = subprocess.run(
            [sys.executable, "-c", code, package], capture_output=True, text=True, timeout=300, check=False
        )
        assert (done.returncode, done.stderr) == end


FLED = """
import os, sys, time
if os.fork() == 0:
    os.setsid()  # out of reach of the group
    time.sleep(30)
    os._exit(0)
{}
"""


@pytest.fixture
def fleeing(package, monkeypatch, tmp_path):
    """Have the isolated process start a child that flees to a session of its own and holds the pipes, then go on."""

    def start(rest: str) -> None:
        (tmp_path / "site").mkdir()
        hook = "import vdfmu.engine.masters.components as c\nplain = c.Components.initialize\n"
        lines = "".join(f"    {line}\n" for line in FLED.format(rest).splitlines())
        hook += f"def initialize(self, *a):\n{lines}    return plain(self, *a)\nc.Components.initialize = initialize\n"
        code = "import sys\nif 'vdfmu.engine.run.isolated_server' in sys.orig_argv:\n"
        code += "".join(f"    {line}\n" for line in hook.splitlines())
        (tmp_path / "site" / "sitecustomize.py").write_text(code)
        monkeypatch.setattr(sys, "path", [str(tmp_path / "site"), *sys.path])

    return start


@pytest.mark.few(1)
@pytest.mark.parametrize(("rest", "said"), [
    ("os._exit(3)", r"ended \(exit code 3\) after this call had returned"),
    *heavy(("os.kill(os.getpid(), 9)", r"components failed .* their process was killed from outside \(SIGKILL\)")),
    *heavy(("time.sleep(60)", "did not continue within 3 s after this call had returned")),
    ("raise ZeroDivisionError('ours')", "ZeroDivisionError: ours .* a fault of vdfmu, not of a component"),
    *heavy(("raise MemoryError", r"process is full: raise memory_limit \(--memory-limit\)")),
])  # fmt: skip
def test_a_child_that_fled_does_not_hold_the_run_and_faults_of_ours_blame_no_component(package, fleeing, rest, said):
    fleeing(rest)
    began = time.monotonic()
    with pytest.raises(CosimError, match=said):
        simulate(package, step=0.25, isolate=True, wait_limit=3.0)
    # 3 s of the limit and the start of Python; the child lives 30 s
    assert time.monotonic() - began < 20.0


def test_a_signal_ends_a_run_whose_process_hangs_with_a_child_that_fled(package, fleeing):
    fleeing("time.sleep(60)")
    timer = threading.Timer(5.0, os.kill, (os.getpid(), signal.SIGTERM))
    began = time.monotonic()
    timer.start()
    with pytest.raises((Interrupted, KeyboardInterrupt)), listening(signal.SIGTERM):
        simulate(package, step=0.25, isolate=True)
    assert time.monotonic() - began < 20.0


def test_a_process_whose_parent_is_gone_ends_in_silence():
    code = "from vdfmu.base.process import Parent; parent = Parent(); parent.read(1); parent.reply(1); print('alive')"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        process.stdout.close()
        process.stdin.write(b"x")
        process.stdin.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0
