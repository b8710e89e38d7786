"""Summaries as JSON that every reader takes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np


def to_json(summary: Mapping[str, Any], indent: int | None = 2) -> str:
    """Return a summary as JSON, which has no NaN and no infinity: they become the texts "nan", "inf" and "-inf"."""
    return json.dumps(_portable(summary), indent=indent, allow_nan=False)


def _portable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _portable(entry) for key, entry in cast("Mapping[Any, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_portable(entry) for entry in cast("list[Any]", value)]
    if isinstance(value, np.generic):
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
