"""Zip files with other contents, and results that are the same."""

import io
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.results.results import Results, Signal


def check_file(path: str | Path, run: bool = True) -> list[str]:
    return inspect_file(path, run).problems


def zipped(members: Mapping[str, str | bytes]) -> bytes:
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    return box.getvalue()


def edited(
    source: Path | bytes, replace: Iterable[tuple[bytes, bytes]] = (), member: str = "modelDescription.xml",
    drop: str | None = None, add: Mapping[str, str | bytes] | None = None,
) -> bytes:  # fmt: skip
    """Return a zip file with patterns in a member replaced, without members that begin with `drop`, and with others."""
    with zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source) as file:
        members = {name: file.read(name) for name in file.namelist() if not (drop and name.startswith(drop))}
    for pattern, text in replace:
        members[member], count = re.subn(pattern, text, members[member], flags=re.DOTALL)
        assert count, pattern
    return zipped(members | dict(add or {}))


def assert_same_bits(some: Results, expected: Results) -> None:
    """Assert that both have the same signals, units, kinds and numbers."""
    assert set(some.names) == set(expected.names)
    assert (some.units, some.kinds) == (expected.units, expected.kinds)
    assert some.time.tobytes() == expected.time.tobytes()
    for name in some:
        assert some[name].dtype == expected[name].dtype
        assert some[name].tobytes() == expected[name].tobytes(), name


def hard_results() -> Results:
    """Return signals of all kinds, with values and names that formats may spoil, and a copy."""
    m, rng = 1300, np.random.default_rng(7)  # more than two blocks of lines
    real = rng.standard_normal((m, 4)) * 10.0 ** rng.integers(-300, 300, (m, 4))
    real[:2, :3] = [[np.nan, -np.inf, 0.1], [-0.0, 5e-324, np.inf]]
    numbers = rng.integers(-(2**31), 2**31 - 1, (m, 2), dtype=np.int32)
    signals = [
        Signal("a.q[1]", "real", "rad", 3), Signal("a.q[2]", "real", "m", 1), Signal("a.q", "integer", "", 1),
        Signal('b"\u00e4,\n', "real", "", 0), Signal("end", "real", "N.m", 2), Signal("a.K_p__", "integer", "", 0),
        Signal("a.on", "boolean", "", 0), Signal("b_1.x", "real", "m", 0), Signal("b1.x", "boolean", "", 0),
    ]  # fmt: skip
    data = {"real": real, "integer": numbers, "boolean": numbers[:, :1] % 2}
    summary = {"limit": np.inf, "path": "\u00e4"}
    return Results(0.001 * np.arange(m) - 0.5, signals, data, summary)


def hollow_results() -> tuple[Results, Results]:
    """Return results without rows, and results without signals."""
    empty = Results(np.empty(0), [Signal("a", "real", "m", 0)], {"real": np.empty((0, 1))})
    return empty, Results(np.arange(3.0), [], {"real": np.empty((3, 0))})


def members(path: Path) -> dict[str, bytes]:
    """Return the content of the members of a zip file by their names."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
