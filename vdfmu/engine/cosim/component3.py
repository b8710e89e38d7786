"""A component of FMI 3.0."""

from __future__ import annotations

import os
from collections.abc import Sequence
from ctypes import CFUNCTYPE, byref, c_bool, c_char, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from functools import partial
from typing import Any

import numpy as np

from vdfmu.engine.cosim.access import Call, Transfer
from vdfmu.engine.cosim.component import Slave, on_message
from vdfmu.engine.cosim.description import Value, Variable
from vdfmu.errors import CosimError

__all__ = ["Slave3"]

_RECEIVER = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)(on_message)
_EVENT, _END, _EARLY = range(3)
"""Answers of doStep."""


class Slave3(Slave):
    """An instance of an FMU of FMI 3.0."""

    prefix, state_name = "fmi3", "FMUState"
    results = {"InstantiateCoSimulation": c_void_p, "FreeInstance": None}  # noqa: RUF012
    dtypes = {  # noqa: RUF012
        "Float64": np.float64, "Float32": np.float32, "Boolean": np.bool_, "String": np.uintp, "Binary": np.uintp,
        **{f"{sign}Int{bits}": np.dtype(f"{sign.lower()}int{bits}") for sign in ("", "U") for bits in (8, 16, 32, 64)},
    }  # fmt: skip

    def make(self) -> int | None:
        """See `Slave.make`."""
        return self.function("InstantiateCoSimulation")(
            self.name.encode(), self.description.guid.encode(), f"{self.folder / 'resources'}{os.sep}".encode(),
            c_bool(False), c_bool(True), c_bool(False), c_bool(False), None, c_size_t(0), c_void_p(self.token),
            _RECEIVER, None,
        )  # fmt: skip

    def prepare(
        self,
        tolerance: float | None,
        start: float,
        stop: float,
        values: Sequence[tuple[Variable, Value]],
    ) -> None:
        """See `Slave.prepare`."""
        self._experiment = (
            c_bool(tolerance is not None), c_double(tolerance or 0.0), c_double(start), c_bool(True), c_double(stop),
        )  # fmt: skip
        structure = [(v, x) for v, x in values if v.causality == "structuralParameter"]
        if structure:
            self.call("EnterConfigurationMode")
            self.set_all(structure)
            self.call("ExitConfigurationMode")
        self.set_all([pair for pair in values if pair not in structure])

    def enter_initialization(self) -> None:
        """See `Slave.enter_initialization`."""
        self.call("EnterInitializationMode", *self._experiment)

    def value_call(self, moved: Transfer) -> Call:
        """See `Slave.value_call`."""
        function, count, n = self.function(moved.verb + moved.native), *moved.counts
        references = byref(moved.references)
        if moved.native == "Binary":
            sizes = byref(c_char.from_buffer(moved.sizes))  # pyright: ignore[reportArgumentType]
            called = moved.around(partial(function, self.argument, references))
            return called, count, sizes, moved.pointer, n, moved.name
        called = moved.around(partial(function, self.argument))
        return called, references, count, moved.pointer, n, moved.name

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """See `Slave.step_call`."""
        step, last = self.function("DoStep"), c_double()
        flags = (c_bool * 4)()
        any_flag = c_uint32.from_buffer(flags)
        answers = *(byref(flags, i) for i in (_EVENT, _END, _EARLY)), byref(last)

        def do_step(component: Any, clock: c_double, size: c_double, keep: Any) -> int:
            status = step(component, clock, size, keep, *answers)
            if any_flag.value and status < 2:
                self._answer(flags, last.value)
            return status

        return do_step, self.argument, clock, size, c_bool(True), "doStep"

    def _answer(self, flags: Any, last: float) -> None:
        """Take what a step has answered beside its status."""
        if flags[_END]:
            self.box.ended[self.name] = last
        elif flags[_EARLY]:
            reason = f"it returned early, at t = {last:.9g} s, which it was not allowed to"
            raise CosimError(self.name, "doStep", self.box.time, reason)
