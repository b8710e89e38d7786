import pytest

from vdfmu.base import interrupt
from vdfmu.base.interrupt import listening
from vdfmu.cli import own_process


@pytest.fixture
def main_in_this_process(monkeypatch):
    """Let ``main``, which is for a process that ends with it, leave signals as they are in one that goes on."""
    for name in ("_last", "_command", "_ended"):
        monkeypatch.setattr(interrupt, name, getattr(interrupt, name))
    monkeypatch.setattr(own_process, "_wanted", False)
    with listening():
        yield
