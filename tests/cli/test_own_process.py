"""Code of users in a separate process: its end is told in words, and it has the terminal of the command."""

import os
import signal
import subprocess
import sys

import pytest

from tests.docs.pages import ROOT
from vdfmu.cli import own_process
from vdfmu.cli.commands import app
from vdfmu.cli.own_process import code_named, foreign_exit
from vdfmu.cli.terminal import fail

UNIT = """
from vdfmu.unit import Output, Unit

class Constant(Unit):
    y = Output("1", text="one")

    def outputs(self):
        self.y = 1.0
"""
SHOW = ["unit", "show", "my_unit.py"]


def command(folder, code, *words, **options):
    """Run a command on a unit after some code; by default show the unit."""
    (folder / "my_unit.py").write_text(f"{code}\n{UNIT}")
    return subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", *(words or SHOW)], cwd=folder, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=120, check=False, **options,
    )  # fmt: skip


@pytest.mark.parametrize("words", [["-q", *SHOW], [*SHOW, "-q"]])
def test_the_separate_process_has_all_words_of_the_command(tmp_path, monkeypatch, main_in_this_process, words):
    again = []
    (tmp_path / "my_unit.py").write_text(UNIT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(own_process, "_wanted", True)
    monkeypatch.setattr(own_process, "run_again", lambda words, code: again.append([*words]) or 0)
    with pytest.raises(SystemExit) as ended:
        app.main(words)
    assert (ended.value.code, again) == (0, [words])


@pytest.mark.heavy
@pytest.mark.parametrize(("code", "says"), [
    ("import os; os.abort()", "my_unit.py: the process that ran this code crashed (Aborted) before the command"),
    ("import os; os._exit(0)", "my_unit.py: the process that ran this code was ended (exit code 0)"),
    ("import ctypes; ctypes.CDLL(None).exit(0)", "was ended (exit code 0) before the command was complete"),
    ("import sys; sys.exit(0)", "my_unit.py, line 1: SystemExit: 0"),
    ("import atexit, sys; atexit.register(sys.exit, 0); 1 / 0", "my_unit.py, line 1: ZeroDivisionError"),
])  # fmt: skip
def test_an_end_without_a_result_is_an_error_in_words(tmp_path, code, says):
    done = command(tmp_path, code)
    assert done.returncode in (1, 2)
    assert says in done.stderr and "Traceback" not in done.stderr
    assert not done.stdout


@pytest.mark.heavy
def test_the_exit_code_and_the_terminal_are_those_of_the_command(tmp_path):
    done = command(tmp_path, "print('hello', input())", input="world\n")
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, "hello world"), done.stderr
    assert "Constant" in done.stdout or "my_unit.py" in done.stdout
    done = command(tmp_path, "x = 6\nbreakpoint()", input="p 7 * x\nc\n")
    assert done.returncode == 0 and "(Pdb) 42" in done.stdout, done.stderr
    done = command(tmp_path, "import os; print(os.getppid())")
    assert done.returncode == 0
    alone = command(tmp_path, "import os; os.abort()", *SHOW, "--no-isolate")
    assert alone.returncode == -signal.SIGABRT  # in the process that the test has started


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_signal_ends_both_processes(tmp_path, number):
    (tmp_path / "my_unit.py").write_text(
        "import os, pathlib, time\npathlib.Path('pid').write_text(str(os.getpid()))\n"
        "pathlib.Path('pid').rename('runs')\ntime.sleep(100)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "vdfmu.cli", *SHOW], cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )  # fmt: skip
    while not (tmp_path / "runs").exists():
        assert process.poll() is None
        signal.sigtimedwait([], 0.05)
    second = os.pidfd_open(int((tmp_path / "runs").read_text()))
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    killed = number == signal.SIGKILL
    assert (process.returncode, said) == ((-number, "") if killed else (128 + number, "stopped\n"))
    import select

    assert select.select([second], [], [], 60)[0]  # a process that has ended is readable
    os.close(second)


def test_names_of_code_are_found_in_arguments_and_in_files_that_they_name(tmp_path):
    files = {
        "arm.toml": 'drive = "my_drive.py"\n',
        "scenario.toml": 'robot = "arm.toml"\nsystem = "more/system.toml"\n',
        "plain.toml": 'robot = "planar_2dof"\nsystem = "plain.toml"\n[controller]\nK_p = 1.0\n',
        "more/system.toml": '[components]\na = { unit = "law.py:A", robot = "../plain.toml" }\n',
        "units.toml": 'extends = "more/system.toml"\n',
        "broken.toml": "x = \n\udcff",
    }
    (tmp_path / "more").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text, errors="surrogateescape")
    named = {name: code_named([name], tmp_path) for name in [*files, "missing.toml", "tracking"]}
    assert named == dict.fromkeys(named, "") | {
        "arm.toml": "my_drive.py", "scenario.toml": "my_drive.py", "more/system.toml": "law.py", "units.toml": "law.py",
    }  # fmt: skip
    assert code_named(["run", "--unit=controller=my_law.py:Law"]) == "my_law.py"
    assert code_named(["a=A.fmu", "b=low_pass.py", "f.casadi"]) == "low_pass.py"
    assert not code_named(["run", "planar_2dof", "results/x", "--set", "controller.K_p=1500", "a=A.fmu"])


def test_an_exit_of_the_command_itself_is_not_one_of_its_code():
    with pytest.raises(SystemExit) as end:
        sys.exit(0)
    assert foreign_exit(end.value) == f"{__file__}, line {end.traceback[-1].lineno + 1}"
    with pytest.raises(SystemExit) as end:
        fail("words", 1)
    assert not foreign_exit(end.value)
