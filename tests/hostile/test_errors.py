"""Errors of other people's code whose message cannot be printed, and names that a terminal would change."""

import inspect

import pytest
from click.testing import CliRunner

from vdfmu.arm.fmus import build_fmus
from vdfmu.base import plugins
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.text import error_text, kind_text
from vdfmu.cli import terminal
from vdfmu.cli.commands import app


class MuteError(Exception):
    """Raises what it is told when it is printed."""

    def __str__(self):
        raise self.args[0]


SAID = "MuteError: its message cannot be printed, because that raises ValueError"


class _Point:
    """An entry point whose module raises."""

    name, value, dist = "mute", "mute:MuteError", None

    def load(self):
        raise MuteError(ValueError)


@pytest.mark.parametrize("raised", [ValueError, SystemExit, RecursionError])
def test_an_error_that_cannot_be_printed_is_named_by_its_kind(raised):
    error = MuteError(raised)
    assert kind_text(error) == f"MuteError: its message cannot be printed, because that raises {raised.__name__}"
    error.add_note("A note")
    assert error_text(error).endswith(f"raises {raised.__name__}. A note")


@pytest.mark.parametrize("words", [["robot", "list"], ["unit", "list"]])
def test_a_package_that_cannot_be_loaded_is_left_out(monkeypatch, caplog, words):
    monkeypatch.setattr(plugins, "_points", lambda group: {"mute": [_Point()]})
    plugins.warn_once.cache_clear()
    done = CliRunner().invoke(app, words)
    assert done.exception is None
    assert SAID in caplog.text


CASES = {
    "module": "raise MuteError(ValueError)",
    "start": "def p(robot): raise MuteError(ValueError)\nclass U(Unit):\n    p = Parameter('m', text='p', start=p)",
    "method": "class U(Unit):\n    y = Output('m', text='y')\n    def outputs(self): raise MuteError(ValueError)",
}


@pytest.mark.parametrize("place", CASES)
def test_a_unit_that_raises_such_an_error_is_refused_in_words(tmp_path, place):
    (tmp_path / "u.py").write_text(
        f"from vdfmu.unit import Output, Parameter, Unit\n{inspect.getsource(MuteError)}{CASES[place]}\n"
    )
    with pytest.raises(VdfmuError, match=SAID):
        build_fmus(None, tmp_path, units=str(tmp_path / "u.py"), backend="python")


@pytest.mark.parametrize("name", ["a:x:b", ":smile:", "[red]x[/red]"])
def test_a_name_is_printed_as_it_is(name, capsys):
    """As an error, a line, and a cell of a table; a terminal would show an emoji, or a colour."""
    terminal.say_error(UsageError(name))
    terminal.say(name)
    terminal.say_list("names", {"a": name}, as_json=False)
    out, err = capsys.readouterr()
    assert err == f"error: {name}\n"
    assert out.splitlines()[0] == name and out.splitlines()[-1].split() == ["a", name]
