"""Progress that a user sees, from Python."""

import pytest

from vdfmu.base import bars
from vdfmu.base.progress import Shown, report, with_progress


@pytest.mark.parametrize("terminal", [True, False])
def test_true_shows_bars_and_a_function_is_called(monkeypatch, capsys, terminal):
    @with_progress
    def work(*, progress: Shown = None) -> None:
        for done in range(3):
            report("count", done, 2)

    monkeypatch.setattr(bars, "errors", bars.EscapedTerminal(stderr=True, force_terminal=terminal, width=100))
    work(progress=True)
    said = capsys.readouterr().err
    assert ("count" in said and "2/2" in said) == terminal  # nothing where nobody looks
    seen: list[tuple[str, int, int]] = []
    work(progress=lambda *step: seen.append(step))
    assert seen == [("count", 0, 2), ("count", 1, 2), ("count", 2, 2)]
    work()
    work(progress=False)
    assert capsys.readouterr().err == ""
