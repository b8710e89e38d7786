"""The program of a system as a module of WebAssembly for a page, written without a compiler."""

from __future__ import annotations

import base64
import gzip
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.evaluate import Call
from vdfmu.compiler.wasm.functions import IMPORTED, WrittenFunctions
from vdfmu.compiler.wasm.module import (
    COPY,
    INTEGER,
    LOAD,
    NUMBER,
    STORE,
    Assembler,
    call,
    constant,
    local,
    number,
    return_if_not,
    unsigned,
)
from vdfmu.system.program.program import MovingUnit, SystemProgram
from vdfmu.system.reference.wired import Action, Carry, Evaluate, TimeSetter


def write_module(program: SystemProgram) -> tuple[bytes, int, tuple[int, int]]:
    """Return a module, the address of the system's memory, and :attr:`Assembler.growth`.

    It exports ``begin()`` and ``step(t, size)``. These return 0, or the number from 1 on of the condition that is not
    met, or of the unit in `SystemProgram.moving` whose solver fails. KernelError if an operation has no code.
    """
    writer = _ModuleWriter(program)
    exported = {"begin": writer.begin(), "step": writer.step()}
    return writer.assembler.module(exported), writer.at, writer.assembler.growth


def page_program(program: SystemProgram) -> dict[str, Any]:
    """Return the data of a program for ``web/master.js``, ready for JSON.

    UsageError for inputs from outside, KernelError if an operation has no code.
    """
    if program.system.outside:
        raise UsageError("some of its inputs come from files")
    module, address, growth = write_module(program)
    parameters: dict[str, dict[str, list[Any]]] = {}
    outputs: dict[str, int] = {}
    for name, unit in program.system.units.items():
        begin, own = program.system.begin(name), parameters.setdefault(name, {})
        for i, v in enumerate(unit.interface.variables):
            if v.type == "Real" and v.causality == "parameter":
                own[v.name] = [begin + i, unit.memory[i].item(), v.minimum, v.maximum]
            elif v.type == "Real" and v.causality == "output":
                outputs[f"{name}.{v.name}"] = begin + i
    return {
        "module": compressed(module),
        "growth": growth,
        "address": address,
        "memory": program.system.memory.tolist(),
        "units": [{"name": name, "parameters": own} for name, own in parameters.items()],
        "names": [*outputs],
        "places": [*outputs.values()],
        "conditions": [words for condition in program.conditions for words in condition.words],
        "moving": [moving.name for moving in program.moving],
        "start": program.grid.begin,
        "stop": program.grid.end,
        "step": program.grid.step,
        "steps": program.grid.n,
        "last": program.grid.last,
    }


def compressed(content: bytes) -> str:
    """Return the text that ``unzip`` of ``web/packed.js`` reads."""
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()


class _ModuleWriter:
    """Writes the functions of a system. `at`: address of its memory."""

    def __init__(self, program: SystemProgram) -> None:
        self.program, self.assembler = program, Assembler(IMPORTED)
        self._functions = WrittenFunctions(self.assembler)
        self.at = self.assembler.room(8 * program.system.memory.size)
        self._still = self.assembler.room(8 * max(unit.interface.size for unit in program.system.units.values()))
        """Rates of the inputs."""
        self._parts = {
            name: self.assembler.function(NUMBER, b"", (), self._actions(actions))
            for name, actions in program.lists.items()
        }

    def _address(self, place: int) -> int:
        return self.at + 8 * place

    def _actions(self, actions: Sequence[Action]) -> bytes:
        """Return the code of actions; the time is the first local."""
        code = bytearray()
        for action in actions:
            if isinstance(action, Carry):
                for start, end in zip(action.starts.tolist(), action.ends.tolist(), strict=True):
                    value = constant(0) + LOAD + unsigned(self._address(start))
                    code += constant(0) + value + STORE + unsigned(self._address(end))
            elif isinstance(action, TimeSetter):
                for place in action.places.tolist():
                    code += constant(0) + local(0) + STORE + unsigned(self._address(place))
            else:
                assert isinstance(action, Evaluate)
                unit = self.program.unit(action.unit)
                for one in getattr(unit.interface.program, action.method):
                    if unit.takes(one):
                        code += self._call(action.unit, one)
        return bytes(code)

    def _call(self, name: str, called: Call) -> bytes:
        """Return the code of a call. Results that it also reads are copied after it."""
        table, begin = self.program.unit(name).interface, self.program.system.begin(name)
        function = table.functions.casadi_function(called.function)
        where = {
            group: self._address(begin + table.arguments[called.group(group)].start)
            for group in (*function.name_in(), *function.name_out())
        }
        sizes = {group: 8 * function.numel_out(group) for group in function.name_out() if called.group(group) != group}
        new = {group: self.assembler.room(size) for group, size in sizes.items()}
        copies = (constant(where[group]) + constant(new[group]) + constant(sizes[group]) + COPY for group in new)
        return self._called(function, where | new) + b"".join(copies)

    def _called(self, function: ca.Function, where: Mapping[str, int]) -> bytes:
        arguments = (constant(where[name]) for name in (*function.name_in(), *function.name_out()))
        return b"".join(arguments) + call(self._functions.index(function))

    def begin(self) -> int:
        """Add the start: states, outputs, and the conditions on several parameters."""
        code, number_ = number(0.0) + call(self._parts["begin"]), 0
        for function, places, words in self.program.conditions:
            where = dict(zip(function.name_in(), map(self._address, places), strict=True))
            (result,), margins = function.name_out(), self.assembler.room(8 * len(words))
            code += self._called(function, where | {result: margins})
            for k in range(len(words)):
                number_ += 1
                met = constant(0) + LOAD + unsigned(margins + 8 * k) + number(0.0) + b"\x66"
                code += met + return_if_not(number_)
        return self.assembler.function(b"", INTEGER, (), code + constant(0))

    def step(self) -> int:
        """Add the communication step."""
        moved, end = call(self.assembler.functions["move_unit"]), local(0) + local(1) + b"\xa0"
        code = end + call(self._parts["part_0"])
        for i, moving in enumerate(self.program.moving):
            where = constant(self._unit(moving)) + constant(self.at) + constant(self.assembler.room(8))
            code += where + local(0) + local(1) + moved + return_if_not(i + 1)
            code += end + call(self._parts[f"part_{i + 1}"])
        return self.assembler.function(2 * NUMBER, INTEGER, (), code + constant(0))

    def _unit(self, moving: MovingUnit) -> int:
        """Return the address of the ``LaneUnit`` of a unit."""
        functions: list[int] = []
        for function, arguments in ((moving.step, 5), (moving.left, 2)):
            if function is None:
                functions.append(0)
                continue
            code = bytearray()
            for name in function.name_in():
                place = moving.place(name)
                code += local(1) if name == "h" else constant(self._still if place is None else self._address(place))
            first = arguments - function.n_out()
            code += b"".join(map(local, range(first, arguments))) + call(self._functions.index(function))
            functions.append(self.assembler.slot(self.assembler.function(arguments * INTEGER, b"", (), bytes(code))))
        code = b"".join(self._call(moving.name, one) for one in moving.update)
        update = self.assembler.slot(self.assembler.function(INTEGER, b"", (), code)) if code else 0
        numbers = (*functions, update, *moving.numbers().values())
        return self.assembler.data(struct.pack(f"<{len(numbers)}i", *numbers))
