"""Files that never end, or that nobody writes, are refused at once wherever a data file may name one."""

import os
from pathlib import Path

import pytest

from vdfmu.base.cache import load, store
from vdfmu.base.errors import UsageError
from vdfmu.base.files import open_regular, read_regular, read_text
from vdfmu.study.run.summary_keys import read_summary
from vdfmu.study.sweeps.axes import draw
from vdfmu.study.sweeps.ledger import readable

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the platform has no pipes in folders")


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


@pytest.mark.parametrize("read", [read_summary, readable, lambda path: draw([], str(path), None, 0)])
def test_a_special_file_is_no_summary_no_study_and_no_points(special, read):
    with pytest.raises(UsageError, match=r"special|Is a directory"):
        read(special)
