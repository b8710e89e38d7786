"""Messages have a bound: long names lose their middle, long lists their end."""

import pytest

from vdfmu import cli
from vdfmu.base.errors import UsageError
from vdfmu.base.text import FEW, close_to, elided, error_text, first_few
from vdfmu.cli import commands


def test_long_names_and_lines_lose_their_middle_and_of_many_messages_the_first_of_each_rule_are_kept():
    name = "a" * 100 + "b" * 9_000_000 + "c" * 100
    text = error_text(UsageError(f"expected x, got {name}. Remove it."))
    assert text.startswith("expected x, got aaaa")
    assert text.endswith("c. Remove it.")
    assert "(9,000,001 characters)" in text  # the point belongs to the word
    assert len(text) < 300
    assert len(elided("ab " * 1_000_000)) < 2100
    lines = elided("\n".join(f"line {i}" for i in range(9_000))).splitlines()
    assert (lines[0], lines[50], lines[-1]) == ("line 0", "... (8,900 lines) ...", "line 8999")
    assert elided("short\nas it is ") == "short\nas it is "
    texts = [f"A {i}" for i in range(9_000)] + ["B 1"]
    kept = first_few(texts, lambda text: text[0])
    assert kept == [*texts[:FEW], "B 1", "and 8,980 more [A]"]
    assert first_few(texts[:FEW]) == texts[:FEW]
    assert close_to("speeds", ["speed", "speed", "mass"]) == "; did you mean speed?"


@pytest.mark.usefixtures("main_in_this_process")
@pytest.mark.parametrize(("error", "said"), [
    (MemoryError(), "the memory does not hold it (MemoryError)"),
    (MemoryError("Unable to allocate 2 GiB"), "the memory does not hold it (Unable to allocate 2 GiB)"),
    (RuntimeError("can't start new thread"), "the memory does not hold it (can't start new thread)"),
    (ImportError("x.so: failed to map segment from shared object"), "(x.so: failed to map segment"),
])  # fmt: skip
def test_a_lack_of_memory_is_a_sentence_for_every_command(monkeypatch, capsys, error, said):
    def command():
        raise error

    monkeypatch.setattr(commands, "command", command)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    assert said in capsys.readouterr().err
