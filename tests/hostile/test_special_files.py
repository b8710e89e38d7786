"""Files that never end, or that nobody writes, are refused at once wherever a data file may name one."""

import os
import socket
from contextlib import closing
from pathlib import Path

import pytest

from vdfmu.arm.imports import import_robot
from vdfmu.base.cache import load, store
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import open_regular, read_regular, read_text
from vdfmu.study.run.summary_keys import read_summary
from vdfmu.study.sweeps.axes import draw
from vdfmu.study.sweeps.ledger import readable

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the platform has no pipes in folders")


@pytest.fixture(params=["pipe", "device", "socket", "folder", "link to a pipe"])
def special(request, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket has at most 107 bytes
    path = Path("special")
    if request.param == "folder":
        path.mkdir()
    elif request.param == "device":
        path.symlink_to("/dev/zero")
    elif request.param == "socket":
        with closing(socket.socket(socket.AF_UNIX)) as listener:
            listener.bind(str(path))
    else:
        os.mkfifo("pipe")
        path.symlink_to("pipe")
    return path


@pytest.mark.parametrize("read", [open_regular, read_regular, read_text])
def test_a_special_file_is_refused_before_it_is_opened(special, read):
    with pytest.raises(OSError, match=r"not a regular file|Is a directory") as refused:
        read(special)
    assert refused.value.filename == str(special)


def test_no_more_is_read_than_the_limit(tmp_path):
    path = tmp_path / "numbers"
    path.write_bytes(bytes(4096))
    assert read_regular(path, 4096) == bytes(4096)
    with pytest.raises(OSError, match="more than the 0.0038147 MiB that are read"):  # 4000 / 2**20
        read_regular(path, 4000)


def test_a_special_file_is_no_entry_of_the_cache(special):
    entry = Path("cache", "fmu", "0" * 64)
    store(entry, b"content")
    entry.unlink()
    special.rename(entry)
    assert load(entry) is None


@pytest.mark.parametrize("text", [
    '<mujoco><include file="special"/></mujoco>',
    '<mujoco><include file="more.xml"/></mujoco>',
    '<mujoco><compiler meshdir="meshes"/><asset><mesh name="a" file="../special"/></asset></mujoco>',
])  # fmt: skip
def test_a_special_file_is_no_part_of_a_model(special, text):
    pytest.importorskip("mujoco")
    Path("meshes").mkdir()
    Path("more.xml").write_text('<mujoco><include file="special"/></mujoco>')
    Path("arm.xml").write_text(text)
    with pytest.raises(ModelError, match=r"special must be a regular file, but"):
        import_robot(Path("arm.xml"))


@pytest.mark.parametrize("read", [read_summary, readable, lambda path: draw([], str(path), None, 0)])
def test_a_special_file_is_no_summary_no_study_and_no_points(special, read):
    with pytest.raises(UsageError, match=r"special|Is a directory"):
        read(special)
