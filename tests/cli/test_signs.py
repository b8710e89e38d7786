"""What a command shows of its work: a line that moves, and what --quiet and --verbose leave and add."""

import re
import subprocess
import sys

import pytest
from click.testing import CliRunner

from tests.cli.terminals import on_terminal
from tests.conftest import ran
from vdfmu.cli.commands import app

WORKS = """
import sys, time
from typing import Annotated
from vdfmu.cli.app import App
from vdfmu.cli.options import Positional
from vdfmu.cli.terminal import say, say_notes
from vdfmu.base.progress import doing

app = App("vdfmu")

@app.command("works", example="")
def works(how: Annotated[str, Positional("How.")]):
    if how == "prints":
        say("first")
    with doing("a long stage of the work"):
        time.sleep(1.5)
    if how == "fails":
        raise SystemExit("error: failed")
    say_notes(["a note"])
    say("last")

import vdfmu.cli.commands
vdfmu.cli.commands.app = app
sys.argv[0] = "vdfmu"
from vdfmu.cli import main
main()
"""
"""Commands that take 1.5 s."""


def plain(text):
    return [line for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "\n", text).splitlines() if line.strip()]


def works(*words, **options):
    return on_terminal([sys.executable, "-c", WORKS, "works", *words], **options)


def test_a_line_and_a_bar_move_while_a_command_works():
    shown = works("prints")
    frames = {line for line in re.split(r"\x1b\[2K|\r|\n", shown.text) if "━" in line}
    assert len([frame for frame in frames if "works" in frame]) > 5  # ten in a second
    assert any("a long stage" in frame for frame in frames)
    # from half a second on, and never a second without anything: imports and the waiting of one line add some 0.5 s
    assert shown.silent < 2.0
    assert [line for line in plain(shown.text) if line in ("first", "note: a note", "last")] == [
        "first", "note: a note", "last",
    ]  # fmt: skip
    assert shown.text.rstrip().endswith("last")
    assert shown.text.count("\x1b[?25h") == shown.text.count("\x1b[?25l") > 0  # the cursor is back


@pytest.mark.parametrize("words", [
    "sweep -q report nowhere", "sweep --verbose report nowhere", "sweep report nowhere -q",
])  # fmt: skip
def test_options_of_all_may_come_before_the_command_of_a_group(words):
    done = CliRunner().invoke(app, words.split())
    assert str(done.exception).startswith("nowhere"), done.exception


def test_results_go_to_the_pipe_and_bars_to_the_terminal():
    shown = works("prints", pipe=True)
    assert shown.output == b"first\nlast\n"
    assert "a long stage" in shown.text
    assert "last" not in shown.text


@pytest.mark.parametrize(("how", "stop", "end"), [("fails", 0.0, "error: failed"), ("ends", 1.0, "stopped")])
def test_an_error_and_ctrl_c_begin_a_line_of_their_own_with_the_cursor_shown(how, stop, end):
    shown = works(how, stop=stop)
    assert shown.code in (1, 130)
    assert plain(shown.text)[-1] == end
    assert shown.text.rindex("\x1b[?25h") > shown.text.rindex("\x1b[?25l")


@pytest.mark.heavy
def test_a_narrow_terminal_without_colours_and_unicode():
    shown = works("ends", width=40, PYTHONIOENCODING="ascii", NO_COLOR="1")
    assert shown.text.isascii()
    assert "----" in shown.text
    assert not re.search(r"\x1b\[[0-9;]*m", shown.text.replace("\x1b[0m", "").replace("\x1b[1m", ""))
    assert max(map(len, plain(shown.text))) <= 40
    assert not [line for line in plain(works("ends", TERM="dumb").text) if "\x1b" in line]


def test_every_command_takes_quiet_and_verbose():
    def leaves(command):
        inner = getattr(command, "commands", {})
        return [leaf for below in inner.values() for leaf in leaves(below)] if inner else [command]

    top = app
    commands = leaves(top)
    assert len(commands) > 15
    for command in (top, *commands):
        options = {option for parameter in command.params for option in parameter.opts}
        assert {"--quiet", "-q", "--verbose", "-v"} <= options, command.name


@pytest.fixture
def invoked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*words):
        done = ran(*words)
        return done.stdout.splitlines(), done.stderr.splitlines()

    return run


@pytest.mark.heavy
def test_quiet_leaves_the_verdict_and_the_files_of_a_run_and_verbose_adds_what_is_done(invoked):
    words = ("run", "planar_tracking", "--stop", "0.01", "--no-reference")
    quiet = invoked(*words, "--quiet")
    files = "report.html, results.csv, summary.json, system.ssp"
    verdict, *rest = quiet[0]
    assert verdict.startswith("✓ Good: modulus margin ") and quiet[1] == []
    assert rest == [f"Written to results/planar_tracking: {files}"]
    output, said = invoked("--verbose", *words)
    assert quiet[0][-1] in output[-3:] and output[-1] == "Open results/planar_tracking/report.html"
    assert len(output) > 10
    for pattern in (r"vdfmu \S+, Python ", r"from the cache: \w", r"co-simulation, 10: \d", "figures: ", "written: "):
        assert any(re.match(rf" +\d+\.\d\d s  {pattern}", line) for line in said), pattern


@pytest.mark.heavy
@pytest.mark.parametrize(
    "words", ["linear planar_2dof", "check robot.toml", "robot reach planar_2dof -o r.toml --overwrite"]
)
def test_quiet_leaves_the_result_of_a_command_that_prints_it(invoked, tmp_path, words):
    from vdfmu.base.files import data_path

    (tmp_path / "robot.toml").write_bytes((data_path("models") / "robots" / "planar_2dof.toml").read_bytes())
    output, _ = invoked(*words.split(), "-v")
    assert output
    assert invoked(*words.split())[0] == output
    assert invoked("--quiet", *words.split()) == (output, [])
    assert invoked(*words.split(), "-q") == (output, [])


@pytest.mark.heavy
def test_verbose_says_where_an_error_is_from_and_no_command_is_silent_for_long(tmp_path):
    def said(*words):
        command = [sys.executable, "-m", "vdfmu.cli", "run", "nope", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        return done.stderr

    short, long = said("--quiet"), said("-v")
    assert short.startswith("error: no scenario 'nope'")
    assert long.splitlines()[1].startswith("Traceback")
    assert long.endswith(short)
    for words in LONG:
        command = [sys.executable, "-m", "vdfmu.cli", *words.split()]
        shown = on_terminal(command, cwd=tmp_path, VDFMU_CACHE_DIR=str(tmp_path / "cache"))
        assert shown.code == 0, shown.text
        word = words.split()[0]
        assert "━" in shown.text, words
        assert any(line.startswith(word) for line in plain(shown.text)), words
        # measured: 1 s at most, the start of Python and C that keeps the interpreter; others may use the processors
        assert shown.silent < 3.0, words


LONG = (
    "build planar_tracking --out fmus", "run planar_tracking --stop 0.5", "ssp planar_tracking",
    "run planar_tracking.ssp --pictures png", "check planar_tracking.ssp", "linear tracking",
    "linear planar_tracking --modes", "robot reach panda_7dof",
    "sweep planar_tracking --vary plant.K_f0=*lin(0.5,2,4) --stop 0.2", "sweep report results/sweep_planar_tracking",
)  # fmt: skip
"""From a cold cache on, each of more than 1 s on two cores."""
