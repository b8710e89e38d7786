"""The cache holds code that is run: whose it must be, and what of it is taken."""

import errno
import json
import logging
import os
import random
import shutil
import stat
import tarfile
import zipfile
from pathlib import Path

import pytest

import vdfmu
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
    assert f"the cache '{shared}' is not used: other users may write to it (mode {mode:o})" in message
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
    (path,) = build_fmus(planar, tmp_path, units=["controller"], folded=True).values()
    whole, place = path.read_bytes(), path.stat().st_ino
    build_fmus(planar, tmp_path, units=["controller"], folded=True)
    assert path.stat().st_ino == place  # what was built is left alone
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    (library,) = [name for name in members if name.startswith("binaries/") and name.endswith((".so", ".dll", ".dylib"))]
    members[library] += b"foreign code"
    pack_zip(path, members)
    assert path.read_bytes() != whole
    build_fmus(planar, tmp_path, units=["controller"], folded=True)
    assert path.read_bytes() == whole


def test_an_entry_that_holds_something_else_is_made_anew(tmp_path):
    """Its digest is right: another program, or another version, stored it under this name."""
    entry = tmp_path / "programs" / "key"
    cache.store(entry, b"no JSON")
    assert cache.load(entry) == b"no JSON"
    assert cache.load(entry, json.loads) is None
    assert cache.load_or_make(entry, lambda: b"[1]", json.loads) == [1]
    assert cache.load(entry) == b"[1]"


def test_a_cache_that_cannot_be_written_is_said_once_with_what_to_do(tmp_path, monkeypatch, caplog):
    def full(*_, **__):
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    monkeypatch.setattr(os, "replace", full)
    with caplog.at_level(logging.WARNING):
        for name in ("one", "other"):
            cache.store(tmp_path / "c" / "native" / name, b"code")
    (message,) = caplog.messages
    assert message.startswith(f"the cache {tmp_path / 'c'} cannot be written: Disk quota exceeded. ")
    assert message.endswith("Free space, or choose another folder with VDFMU_CACHE_DIR.")
    assert not list((tmp_path / "c" / "native").iterdir())


@pytest.mark.heavy
@pytest.mark.parametrize("content", [b"", b"wrong", b"[1, 2]", b'{"reason": 3}'])
def test_a_run_with_wrong_entries_is_the_run_with_none(tmp_path, monkeypatch, content):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))

    def page() -> bytes:
        vdfmu.run("planar_tracking", stop=0.02, reference=False, simulate=True, out=tmp_path / "out")
        return (tmp_path / "out" / "report.html").read_bytes()

    whole = page()
    entries = [entry.path for entry in cache.entries(tmp_path / "cache") if entry.path.parent.name != "seals"]
    assert len(entries) > 20
    for entry in entries:
        cache.store(entry, content)
    # pages differ in the times that the runs took
    assert abs(len(page()) - len(whole)) < 100


def zeroed(data):
    return data[:-60] + bytes(20) + data[-40:]


@pytest.mark.parametrize("damage", [
    lambda data: data, lambda data: data[: len(data) // 2], lambda data: b"no archive", zeroed,
])  # fmt: skip
@pytest.mark.parametrize("change", [lambda entry: entry, lambda entry: entry[:-1] + b"X"])
def test_what_the_package_brought_is_taken_whole_or_not_at_all(tmp_path, monkeypatch, damage, change):
    """A damaged archive, or an entry with a wrong digest, never comes into the cache of the user."""
    entry, brought = tmp_path / "user" / "native" / "key", tmp_path / "native.tar.xz"
    made = tmp_path / "maker" / "native" / "key"
    cache.store(made, code := random.Random(1).randbytes(10_000))
    made.write_bytes(change(whole := made.read_bytes()))
    with tarfile.open(brought, "w:xz") as archive:
        archive.add(made, "key")
    brought.write_bytes(damage(packed := brought.read_bytes()))
    good = made.read_bytes() == whole and brought.read_bytes() == packed
    monkeypatch.setattr(cache, "PREBUILT", tmp_path)
    for _ in range(2):
        cache._prebuilt.cache_clear()
        assert cache.load(entry) == (code if good else None)
        assert entry.exists() == good
    cache._prebuilt.cache_clear()
    brought.unlink()
    assert cache.load(entry) == (code if good else None)
    assert cache.load(entry.with_name("other")) is None
