"""The call of a unit's method, in which nothing that is refused can be caught."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from vdfmu.base.files import PACKAGE
from vdfmu.compiler.scalar.symbol import refusal, refusals


def call(method: Callable[[], Any], file: Path | None) -> Any:
    """Call a method, and raise what values or a symbol refuse, even if the method catches it.

    So are errors of types and attributes in the code of `file` and the files beside it: functions of numpy and other
    libraries raise them for objects, which they do not know.
    """
    refused: list[Exception] = []
    token, tracer = refusals.set(refused), sys.gettrace()

    def look(frame: FrameType, event: str, argument: Any) -> Any:
        if event == "exception" and isinstance(argument[1], (TypeError, AttributeError)):
            refusal(argument[1])
        return look if os.path.dirname(frame.f_code.co_filename) == str(file.parent if file else "") else None

    try:
        if file is not None and PACKAGE not in file.parents and tracer is None:  # else a debugger needs its place
            sys.settrace(look)
        with np.errstate(all="ignore"):
            result = method()
    except Exception:
        if not refused:
            raise
        result = None
    finally:
        sys.settrace(tracer)
        refusals.reset(token)
    if refused:
        raise refused[0]
    return result
