"""Temporary folders and signals: whenever one comes, nothing is left."""

import signal
import sys
import tempfile
from pathlib import Path

import pytest

from vdfmu.base.files import temporary_folder
from vdfmu.base.interrupt import listening


def use_a_folder() -> None:
    with temporary_folder("vdfmu_") as folder:
        Path(folder, "inside").mkdir()
        Path(folder, "inside", "file").write_text("text")


def interrupted_at(event: int, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Send Ctrl-C at the call or return of this number; return whether there are as many, and it ended the block."""
    count, sent, seen = 0, False, False

    def profile(*_: object) -> None:
        nonlocal count, sent
        count += 1
        if count == event:
            sent = True
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("vdfmu.base.interrupt._last", -1e9)  # the last one was long ago
    try:
        sys.setprofile(profile)  # what it raises ends it too
        use_a_folder()
        sys.setprofile(None)
    except KeyboardInterrupt:
        seen = True
    assert seen or not sent, f"lost at event {event}"
    return sent


def test_ctrl_c_leaves_no_folder_whenever_it_comes(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    with listening(signal.SIGINT):
        event = 1
        while interrupted_at(event, monkeypatch):
            assert list(tmp_path.iterdir()) == [], f"left at event {event}"
            event += 1
    assert event > 50  # it was sent while the folder was made and removed, too
