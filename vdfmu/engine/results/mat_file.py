"""Results as a MATLAB file of version 5: an array for each signal or group, under a name that is legal in MATLAB.

``time`` (m, 1) in s, ``plant_q`` (m, n) of the signals ``plant.q[1]`` to ``[n]``; ``units`` has a field for each.
The text ``vdfmu``, for ``jsondecode``, has the names, kinds and units of the signals, and the summary.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import replacing
from vdfmu.base.unpack import mat_variables
from vdfmu.engine.results.formats import Format
from vdfmu.engine.results.recorded import Recorded, from_arrays, from_facts, grouped, legal_names, no_rows, to_facts

_HEAD = b"MATLAB 5.0 MAT-file, written by vdfmu"
"""Takes the place of a head with the time of the day, so that the same run has the same bytes."""
_MOST = 2**31 - 2**10
"""Bytes of an array: the format has 32 bits for its size."""
_LONGEST = 63
"""Letters of a name in MATLAB."""
_TAKEN = (
    "time", "units", "vdfmu", "break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for",
    "function", "global", "if", "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while",
)  # fmt: skip


def write_mat(results: Recorded, path: Path) -> None:
    """Write the signals, their units, and the summary."""
    from scipy.io import savemat

    groups = grouped(results.signals)
    names = legal_names([name for name, _ in groups], _TAKEN, _LONGEST)
    content: dict[str, Any] = {"time": results.time[:, None], "units": {"time": "s"}}
    for name, ((_, kind), members) in zip(names, groups.items(), strict=True):
        array = results.data[kind][:, [s.column for s in members]]
        if array.nbytes > _MOST:
            raise VdfmuError(
                f"{path}: {name}: expected at most 2 GB, as MATLAB's version 5 has it, got {array.nbytes / 1e9:.3g} GB."
                " Write Parquet, which MATLAB reads by parquetread: --format parquet."
            )
        content[name] = array.astype(bool) if kind == "boolean" else array
        units = list(dict.fromkeys(s.unit for s in members))
        content["units"][name] = units[0] if len(units) == 1 else np.array([s.unit for s in members], object)
    content["vdfmu"] = json.dumps(json.loads(to_facts(results)))  # letters beyond ASCII as \u, which every reader has
    try:
        with replacing(path) as file:
            savemat(file, content, long_field_names=True)
            file.seek(0)
            file.write(_HEAD.ljust(116))
    except OSError as error:
        raise no_rows(path, error) from None


def read_mat(path: Path) -> Recorded:
    """Read what `write_mat` wrote."""
    found = mat_variables(path)
    try:
        signals, summary = from_facts(str(found["vdfmu"]))
    except (KeyError, TypeError, ValueError):
        raise UsageError(
            f"{path}: expected results that vdfmu wrote, with the variable vdfmu; there are {', '.join(found)}."
        ) from None
    groups = grouped(signals)
    names = legal_names([name for name, _ in groups], _TAKEN, _LONGEST)
    try:
        arrays = [found[name].reshape(-1, len(each)) for name, each in zip(names, groups.values(), strict=True)]
        return from_arrays(found["time"].reshape(-1), signals, arrays, summary)
    except (KeyError, ValueError) as error:
        raise UsageError(f"{path}: expected an array for each signal of the variable vdfmu: {error}.") from None


FORMAT = Format(lambda: None, write_mat, read_mat)
