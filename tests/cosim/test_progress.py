"""Progress that a user sees, from Python."""

from __future__ import annotations

import pytest

from vdfmu import bars
from vdfmu.progress import Shown, called, with_bars


@pytest.mark.parametrize("terminal", [True, False])
def test_true_shows_bars_and_a_function_is_called(monkeypatch, capsys, terminal):
    @with_bars
    def work(*, progress: Shown = None) -> bool:
        for done in range(3):
            called(progress)("count", done, 2)
        return callable(progress)

    monkeypatch.setattr(bars, "errors", bars.Terminal(stderr=True, force_terminal=terminal, width=100))
    assert work(progress=True)
    said = capsys.readouterr().err
    assert ("count" in said and "2/2" in said) == terminal  # nothing where nobody looks
    seen: list[tuple[str, int, int]] = []
    work(progress=lambda *step: seen.append(step))
    assert seen == [("count", 0, 2), ("count", 1, 2), ("count", 2, 2)]
    assert not work()
    assert not work(progress=False)
    assert capsys.readouterr().err == ""
