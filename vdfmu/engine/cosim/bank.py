"""The memory that units and master share: values of all connected variables of a type, in place."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import addressof, byref, c_size_t, c_uint, c_void_p, create_string_buffer, string_at
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.engine.cosim.checked import Checked
from vdfmu.engine.cosim.component import C_TYPE, Slave
from vdfmu.engine.cosim.description import Variable
from vdfmu.engine.cosim.link import Link, Port

__all__ = ["Bank", "Call", "component_argument"]

Call = tuple[Any, Any, Any, Any, Any, str]
"""An FMI function, its four arguments, and its name for messages."""


class Bank:
    """All outputs and connected inputs of one FMI type, in one array: ``[outputs | inputs]``.

    The ctypes arrays that FMI calls fill lie in the same memory, one window for each unit's outputs and one
    for its inputs. In an input window the fresh inputs (see `Schedule`) come first. Of texts the array holds addresses,
    the same for the same text, of copies that last as long as the bank: those of a unit last until its next step.
    """

    def __init__(self, kind: str, checked: Checked, words: NDArray[np.float64]) -> None:
        self.kind = kind
        fresh = checked.schedule.fresh
        links = {link.end: link for link in checked.links if link.stepped}
        outputs: list[tuple[str, Variable]] = []
        inputs: list[tuple[str, Variable]] = []
        self.output_windows: dict[str, slice] = {}
        self.input_windows: dict[str, slice] = {}
        for unit, description in checked.sources.items():
            own = [v for v in description.named("output") if v.fmi_type == kind]
            self.output_windows[unit] = slice(len(outputs), len(outputs) + len(own))
            outputs += [(unit, v) for v in own]
            fed = [
                v for v in description.named("input")
                if v.fmi_type == kind and (unit, v.name) in links
            ]  # fmt: skip
            fed.sort(key=lambda v, unit=unit: (unit, v.name) not in fresh)
            self.input_windows[unit] = slice(len(inputs), len(inputs) + len(fed))
            inputs += [(unit, v) for v in fed]
        self.variables = [*outputs, *inputs]
        dtype = {"Real": np.float64, "String": np.uintp}.get(kind, np.int32)
        self._texts: dict[bytes, Any] = {}
        self.memory: NDArray[Any] = words.view(dtype)[: len(self.variables)]
        self.words = -(-self.memory.nbytes // words.itemsize)
        self.outputs = self.memory[: len(outputs)]
        self.inputs = self.memory[len(outputs) :]
        self.position: dict[Port, int] = {(u, v.name): i for i, (u, v) in enumerate(self.variables)}
        self.links: list[Link] = [links[u, v.name] for u, v in inputs]
        self.fresh_counts = {
            unit: sum((u, v.name) in fresh for u, v in inputs[window])
            for unit, window in self.input_windows.items()
        }

    def gather(self, window: slice) -> Callable[[], None] | None:
        """Return a function that brings the inputs of a window up to date; None for an empty window."""
        links = self.links[window]
        if not links:
            return None
        sources = np.array([self.position[link.start] for link in links], np.intp)
        target, take = self.inputs[window], self.outputs.take
        factor = np.array([link.conversion.factor for link in links])
        offset = np.array([link.conversion.offset for link in links])
        tables = [
            (i, link.conversion.table) for i, link in enumerate(links) if link.conversion.table is not None
        ]

        def plain() -> None:
            take(sources, None, target, "clip")  # the mode that needs no buffer; the indices are valid

        def scaled() -> None:
            take(sources, None, target, "clip")
            np.multiply(target, factor, target)
            np.add(target, offset, target)

        def mapped() -> None:
            take(sources, None, target, "clip")
            for i, table in tables:
                target[i] = table.get(int(target[i]), int(target[i]))

        if tables:
            return mapped
        return plain if all(link.conversion.trivial for link in links) else scaled

    def kept(self, text: bytes) -> int:
        """Return the address of the copy of a text."""
        return addressof(self._texts.setdefault(text, create_string_buffer(text)))

    def call(self, slave: Slave, verb: str) -> Call | None:
        """Return the vectorised ``Get`` or ``Set`` of a unit's window; None when it is empty."""
        window = (self.output_windows if verb == "Get" else self.input_windows)[slave.name]
        part = (self.outputs if verb == "Get" else self.inputs)[window]
        n = part.size
        if n == 0:
            return None
        shift = 0 if verb == "Get" else self.outputs.size
        names = self.variables[window.start + shift : window.stop + shift]
        references = (c_uint * n)(*(v.reference for _, v in names))
        place = part.ctypes.data - self.memory.ctypes.data
        values = (C_TYPE[self.kind] * n).from_buffer(self.memory, place)  # pyright: ignore[reportArgumentType]
        function = slave.function(f"fmi2{verb}{self.kind}")
        if self.kind == "String" and verb == "Get":
            function = self._keeping(function, part)
        name = f"{verb.lower()}{self.kind}"
        return (
            function,
            component_argument(slave),
            byref(references),
            c_size_t.from_param(n),
            byref(values),
            name,
        )

    def _keeping(self, get: Callable[..., int], part: NDArray[Any]) -> Callable[..., int]:
        """Return a fmi2GetString that leaves copies of the texts in `part`."""

        def call(*arguments: Any) -> int:
            status = get(*arguments)
            part[:] = [self.kept(string_at(int(address)) if address else b"") for address in part]
            return status

        return call


def component_argument(slave: Slave) -> Any:
    """Return the instance as an argument that is made ready once: ctypes would do it anew in each call."""
    return c_void_p.from_param(slave.component.value)  # pyright: ignore[reportArgumentType]
