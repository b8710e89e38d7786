"""Results as a MATLAB file of version 5: an array for each signal or group, with a valid MATLAB name.

``time`` (m, 1) in s, ``plant_q`` (m, n) of the signals ``plant.q[1]`` to ``[n]``; ``units`` has a field for each.
The text ``vdfmu``, to be read with ``jsondecode``, contains the names, kinds and units of the signals, and the summary.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import read_json, replacing
from vdfmu.base.foreign import Foreign, read_foreign
from vdfmu.base.text import to_json
from vdfmu.engine.results.arrays import grouped, no_rows, placed_arrays
from vdfmu.engine.results.formats import Format
from vdfmu.engine.results.results import Recorded, Signal

_HEAD = b"MATLAB 5.0 MAT-file, written by vdfmu"
"""Replaces a header that contains the time of day, so that files are reproducible."""
_MOST = 2**31 - 2**10
"""Largest array [byte], because the format has 32 bits for its size."""
_LONGEST = 63
"""Characters that MATLAB does not allow in a name."""
_TAKEN = (
    "time",
    "units",
    "vdfmu",
    "break",
    "case",
    "catch",
    "classdef",
    "continue",
    "else",
    "elseif",
    "end",
    "for",
    "function",
    "global",
    "if",
    "otherwise",
    "parfor",
    "persistent",
    "return",
    "spmd",
    "switch",
    "try",
    "while",
)


def write_mat(results: Recorded, path: Path) -> None:
    """Write the signals, their units, and the summary."""
    from scipy.io import savemat

    groups = grouped(results.signals)
    names = _legal_names(groups)
    content: dict[str, Any] = {"time": results.time[:, None], "units": {"time": "s"}}
    for name, ((_, kind), members) in zip(names, groups.items(), strict=True):
        array = results.data[kind][:, [s.column for s in members]]
        if array.nbytes > _MOST:
            raise VdfmuError(
                f"{path}: {name}: must be at most 2 GB in a MATLAB 5 file, got {array.nbytes / 1e9:.3g} GB."
                " Write Parquet instead, --format parquet, and read it with MATLAB's parquetread."
            )
        content[name] = array.astype(bool) if kind == "boolean" else array
        units = list(dict.fromkeys(s.unit for s in members))
        content["units"][name] = units[0] if len(units) == 1 else np.array([s.unit for s in members], object)
    content["vdfmu"] = to_json({"signals": [s[:3] for s in results.signals], "summary": results.summary}, None)
    try:
        with replacing(path) as file:
            savemat(file, content, long_field_names=True)
            file.seek(0)
            file.write(_HEAD.ljust(116))
    except OSError as error:
        raise no_rows(path, error) from None


def read_mat(path: Path) -> Recorded:
    """Read a file of `write_mat`."""
    return mat_results(read_foreign(path))


def mat_results(content: Foreign) -> Recorded:
    """Return the results in the content of a MATLAB file."""
    path, arrays = content.path, content.arrays
    try:
        facts = read_json(content.texts["vdfmu"])
        signals = [Signal(name, kind, unit, 0) for name, kind, unit in facts["signals"]]
        summary = dict(facts["summary"])
        groups = grouped(signals)
    except (KeyError, TypeError, ValueError):
        raise UsageError(
            f"{path}: expected results that vdfmu wrote, with the variable vdfmu; {content.listed()}."
        ) from None
    try:
        ordered = [
            arrays[name].reshape(-1, len(each))
            for name, each in zip(_legal_names(groups), groups.values(), strict=True)
        ]
        return Recorded(arrays["time"].reshape(-1), *placed_arrays(signals, ordered), summary)
    except (KeyError, ValueError) as error:
        raise UsageError(f"{path}: expected an array for each signal of the variable vdfmu: {error}.") from None


def _legal_names(groups: Iterable[tuple[str, str]]) -> list[str]:
    """Return a unique valid MATLAB name for each group."""
    used, names = {name.lower() for name in _TAKEN}, list[str]()
    for name, _ in groups:
        legal = re.sub(r"[^A-Za-z0-9_]", "_", name)
        legal = (legal if re.match("[A-Za-z]", legal) else f"x{legal}")[: _LONGEST - 4]
        k, base = 1, legal
        while legal.lower() in used:
            k += 1
            legal = f"{base}_{k}"
        used.add(legal.lower())
        names.append(legal)
    return names


FORMAT = Format(lambda: None, write_mat, read_mat)
