"""Actions of a system as compiled functions, from the C of the traced functions that native FMUs are made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from ctypes import PyDLL, c_double, c_void_p
from functools import partial
from typing import Any

import casadi as ca

from vdfmu.base.errors import LOG, FmuError, KernelError
from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.files import kernel_source
from vdfmu.compiler.c.loaded import SHOWN, loaded
from vdfmu.compiler.c.platforms import native_available
from vdfmu.compiler.c.text import setting_lines
from vdfmu.compiler.unit.evaluate import Call, Traced
from vdfmu.system.reference.wired import Action, AtNewTime, Carry, Run, TimeSetter, WiredUnits


def runs(
    system: WiredUnits, lists: Mapping[str, Sequence[Action]], files: Mapping[str, bytes] | None
) -> dict[str, Run]:
    """Return what runs each list of actions.

    Parameters
    ----------
    system : WiredUnits
    lists : mapping of str to actions
    files : mapping of str to bytes, or None
        Their :func:`sources`. Without them, or the compiler, the actions run in Python, with the same results to
        rounding.
    """
    if files is not None and native_available():
        try:
            # calls take less time than to let another thread run
            library = loaded(files, "system", PyDLL)
        except FmuError:  # such as when there is no room
            pass
        else:
            return {name: _run(library[name], system.memory.ctypes.data) for name in lists}
    return {name: system.python(actions) for name, actions in lists.items()}


def _run(function: Any, memory: int) -> Run:
    """Return what calls a compiled function with the memory at an address and a time [s]."""
    function.argtypes, function.restype = (c_void_p, c_double), None
    return partial(function, c_void_p(memory))


def sources(system: WiredUnits, lists: Mapping[str, Sequence[Action]]) -> dict[str, bytes] | None:
    """Return file name to C text of lists of actions; None where a unit has no C."""
    code = Code(system)
    try:
        functions = [f"SHOWN {code.function(name, actions)}" for name, actions in lists.items()]
        files = {
            f"kernel_{name}.c": kernel_source(made, code.joints[name]).encode() for name, made in code.called.items()
        }
    except KernelError as error:  # an operation that has no C text, or a unit in plain Python
        LOG.info("the references run in Python: %s", error)
        return None
    prototypes = "".join(f"{c_prototype(made)};\n" for made in code.called.values())
    text = "\n".join(["#include <string.h>\n", SHOWN, prototypes, *functions])
    return {**files, "system.c": text.encode()}


class Code:
    """C text of actions. `called`: the traced functions that it calls, `joints`: of their units' robots."""

    head = "double *m, double t"
    unused = "(void)t;"

    def __init__(self, system: WiredUnits) -> None:
        self.system = system
        self.called: dict[str, ca.Function] = {}
        self.joints: dict[str, int] = {}
        self._taken: dict[str, ca.Function] = {}

    def function(self, name: str, actions: Sequence[Action]) -> str:
        """Return ``void name(double *m, double t)``, with m the memory and t the time."""
        lines = [line for action in actions for line in self._lines(action)]
        body = "".join(f"    {line}\n" for line in [self.unused, *lines])
        return f"void {name}({self.head})\n{{\n{body}}}\n"

    def _lines(self, action: Action) -> Iterator[str]:
        if isinstance(action, Carry):
            for start, end in zip(action.starts.tolist(), action.ends.tolist(), strict=True):
                yield f"m[{end}] = m[{start}];"
        elif isinstance(action, TimeSetter):
            for place in action.places.tolist():
                yield f"m[{place}] = t;"
        elif isinstance(action, AtNewTime):
            yield f"if (m[{action.place}] != t) {{"
            yield from (line for one in action.actions for line in self._lines(one))
            yield f"m[{action.place}] = t;"
            yield "}"
        else:
            unit = self.system.units[action.unit]
            if not isinstance(unit, Traced):
                raise KernelError(f"{action.unit} has no traced functions.")
            for call in getattr(unit.interface.program, action.method):
                if unit.takes(call):  # choices are fixed: what they leave out is not compiled
                    yield from self.call(action.unit, unit, call)

    def call(self, name: str, unit: Traced, call: Call) -> Iterator[str]:
        """Yield the lines of a call."""
        interface, begin = unit.interface, self.system.begin(name)
        function = self.take(interface.functions.casadi_function(call.function))
        self.joints[function.name()] = interface.joints
        names = (*function.name_in(), *function.name_out())
        places = {name: f"m + {begin + interface.arguments[call.group(name)].start}" for name in names}
        given = [places[name] for name in function.name_in()]
        made = [(key, places[key], function.numel_out(key), call.group(key) != key) for key in function.name_out()]
        yield from ("{", *(f"    {line}" for line in setting_lines(function.name(), given, made)), "}")

    def take(self, function: ca.Function) -> ca.Function:
        """Note that a traced function is called; return it, under another name where another robot's has its own."""
        name, number = function.name(), 1
        while (known := self._taken.setdefault(name, function)) is not function:
            if known.serialize() == function.serialize():
                break
            number += 1
            name = f"{function.name()}_{number}"
        if name not in self.called:
            self.called[name] = known if name == known.name() else _named(known, name)
        return self.called[name]


def _named(function: ca.Function, name: str) -> ca.Function:
    """Return the same function under another name."""
    inputs = [ca.SX.sym(one, *function.size_in(one)) for one in function.name_in()]
    return ca.Function(name, inputs, function.call(inputs), function.name_in(), function.name_out())
