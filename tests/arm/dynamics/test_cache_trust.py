"""The cache holds code that is run: whose it must be, and what of it is taken."""

import logging
import os
import shutil
import stat
import zipfile
from pathlib import Path

import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.base import cache
from vdfmu.base.files import pack_zip


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    """No message said yet, and a user's cache folder that is empty."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "own")
    cache.warn_once.cache_clear()


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
def test_a_cache_that_others_may_write_to_is_not_used(tmp_path, monkeypatch, caplog, mode):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(mode)
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(shared))
    with caplog.at_level(logging.WARNING):
        assert cache.cache_folder() == tmp_path / "own"
        assert cache.cache_folder() == tmp_path / "own"
    (message,) = caplog.messages
    assert f"the cache '{shared}' is not used: others may write to it (mode {mode:o})" in message
    assert "choose another with VDFMU_CACHE_DIR" in message
    shared.chmod(0o755)
    assert cache.cache_folder() == shared


def test_a_cache_of_another_user_is_not_used(tmp_path, monkeypatch, caplog):
    """Where the user's own is of another user too, a folder of this process takes its place."""
    owner = os.geteuid()
    for name in ("shared", "own"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "shared"))
    cache._private.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: owner + 1)
        folder = cache.cache_folder()
        assert cache.cache_folder() == folder
    assert folder.parent == Path(cache.tempfile.gettempdir())
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert [f"it belongs to user {owner}, not to {owner + 1}" in text for text in caplog.messages] == [True, True]
    cache._private().cleanup()
    cache._private.cache_clear()


def test_a_file_of_another_user_or_open_to_others_is_not_loaded(tmp_path, monkeypatch):
    file = tmp_path / "c" / "native" / "key"
    cache.store(file, b"code")
    assert cache.load(file) == b"code"
    file.chmod(0o660)
    assert cache.load(file) is None
    file.chmod(0o644)
    assert cache.load(file) == b"code"
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert cache.load(file) is None


def test_what_is_made_is_for_the_user_alone(tmp_path):
    """Whatever the umask: 002 is common."""
    before = os.umask(0o002)
    try:
        cache.store(tmp_path / "c" / "native" / "key", b"code")
    finally:
        os.umask(before)
    for path, mode in (("c", 0o700), ("c/native", 0o700), ("c/native/key", 0o600)):
        assert stat.S_IMODE((tmp_path / path).stat().st_mode) == mode, path


def test_no_entry_stands_for_another(tmp_path):
    entry, other = (tmp_path / "native" / name for name in ("one", "other"))
    cache.store(entry, b"code")
    shutil.copy(entry, other)
    assert cache.load(entry) == b"code"
    assert cache.load(other) is None


@pytest.mark.heavy
def test_a_changed_library_with_the_right_guid_is_replaced(planar, tmp_path):
    (path,) = build_fmus(planar, tmp_path, units=["controller"]).values()
    whole, place = path.read_bytes(), path.stat().st_ino
    build_fmus(planar, tmp_path, units=["controller"])
    assert path.stat().st_ino == place  # what was built is left alone
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    (library,) = [name for name in members if name.startswith("binaries/") and name.endswith((".so", ".dll", ".dylib"))]
    members[library] += b"foreign code"
    pack_zip(path, members)
    assert path.read_bytes() != whole
    build_fmus(planar, tmp_path, units=["controller"])
    assert path.read_bytes() == whole
