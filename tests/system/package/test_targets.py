"""Where packages are written: links, special files, folders, modes, and what a failure leaves behind."""

import errno
import os
import stat

import pytest

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import pack_zip, read_member, replacing, write_whole
from vdfmu.system.package.write import write_ssp


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the platform has no pipes in folders")
def test_a_special_file_is_refused_and_stays(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link):
        with pytest.raises(StorageError, match="is a device, a pipe or another special file; expected a regular"):
            pack_zip(path, {"a": b"1"})
        with pytest.raises(StorageError, match="is a device, a pipe or another special file; expected a regular"):
            write_whole(path, [b"1"])
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert sorted(tmp_path.iterdir()) == [link, pipe]


@pytest.mark.parametrize("exists", [True, False])
def test_a_link_stays_and_its_file_is_written(tmp_path, exists):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "x.zip", tmp_path / "link.zip"
    if exists:
        target.write_bytes(b"old")
    link.symlink_to(target)
    pack_zip(link, {"a": b"1"})
    assert link.is_symlink()
    assert read_member(target, "a") == b"1"
    assert list(target.parent.iterdir()) == [target]
    write_whole(link, [b"2"])
    assert link.is_symlink()
    assert target.read_bytes() == b"2"


def test_links_in_a_circle_are_refused(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    a.symlink_to(b)
    b.symlink_to(a)
    with pytest.raises(StorageError, match="cannot be written|special file"):
        pack_zip(a, {"a": b"1"})
    assert a.is_symlink()


@pytest.mark.parametrize("mask", [0o077, 0o027, 0o002])
def test_the_umask_counts(tmp_path, mask):
    before = os.umask(mask)
    try:
        pack_zip(tmp_path / "x.zip", {"a": b"1"})
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "x.zip").stat().st_mode) == 0o666 & ~mask


def test_a_file_that_fails_leaves_the_old_one(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"old")
    with pytest.raises(OSError, match="full"), replacing(path) as stream:
        stream.write(b"half")
        raise OSError(errno.ENOSPC, "full")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_package_needs_the_name_of_a_file(scenario, fmus, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for path in ("folder", "."):  # the command line makes "." of an empty name
        with pytest.raises(StorageError, match=r"is a folder; expected the name of a file to write"):
            write_ssp(scenario, {}, path)
    with pytest.raises(StorageError, match=r"the name of the file to write is empty"):
        write_ssp(scenario, {}, "")
    (tmp_path / "file").write_bytes(b"1")
    with pytest.raises(StorageError, match=r"^file/x.ssp: cannot be written"):
        write_ssp(scenario, fmus, "file/x.ssp")


def test_a_package_needs_an_fmu_of_each_component(scenario, fmus, tmp_path):
    fewer = {name: fmu for name, fmu in fmus.items() if name not in ("plant", "controller")}
    with pytest.raises(UsageError, match="of each component of .*, got none of controller, plant"):
        write_ssp(scenario, fewer, tmp_path / "x.ssp")
    assert not (tmp_path / "x.ssp").exists()
