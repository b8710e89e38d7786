"""The loop over the steps in ``compiled.c``: its library, and the structures that it shares with Python."""

from __future__ import annotations

from ctypes import CDLL, Structure, c_double, c_int, c_long, c_size_t, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import Any

COPY, SCALED, CHANGED, PREDICTED, LINE, RAMP, VALUES, _, STEP, _, RATES, _ = range(12)
"""Kinds of actions. For FMI 3.0 the number of a call's kind is one higher."""
NO_COMPILER = "no C compiler"
"""Reason why the loop cannot be compiled here."""
NOT_FINITE, EVENT, BY_HAND = 2, 3, 4
"""Return values of the loop."""


def _fields(**names: str) -> list[tuple[str, Any]]:
    """Return the fields of a structure; the type is the first letter of each keyword."""
    types = {"i": c_int, "l": c_long, "d": c_double, "n": c_size_t, "p": c_void_p}
    return [(name, types[letter[0]]) for letter, listed in names.items() for name in listed.split()]


class Action(Structure):
    """A copy or a call."""

    _fields_ = _fields(
        i="kind types number", l="every at_end from_row part parts", d="last", p="function component references",
        n="n_references n", p2="values source to from_ factor offset more flags reached",
    )  # fmt: skip


class RowBlock(Structure):
    """Rows of some signals of a type."""

    _fields_ = _fields(p="block memory columns", n="n size", l="first")


class Master(Structure):
    """All data of the loop."""

    _fields_ = _fields(
        p="actions rows outputs watched", n="n_actions n_rows n_watched", p2="clock size time waiting",
        d="begin step rest", l="n", p3="row running", n2="action", i="status", d2="point length event", i2="pending",
    )  # fmt: skip


@lru_cache
def library() -> CDLL | None:
    """Return the compiled loop; None without a compiler or disk space."""
    from vdfmu.base.compile import own_library

    loop = own_library(Path(__file__).with_name("compiled.c"))
    if loop is not None:
        loop.do_steps.argtypes = [c_void_p, c_size_t, c_long, c_double]
    return loop
