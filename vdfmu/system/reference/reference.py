"""References for a co-simulation: a system of units solved by scipy, without FMI and without a master.

The three references (communication points t_k, step h, inputs held over a step):

- ``sampled``: an output with feedthrough is calculated from all values at t_k, for the step from t_k, and read in the
  same step. Ordered masters must reproduce this.
- ``sampled-delayed``: every unit reads other outputs one sample late. Other sampled masters must reproduce this.
- ``continuous``: only the units' sampled states are sampled. Both others tend to this as the step shrinks.

They use the wiring and the traced functions of the units, compiled if a compiler is installed. The tests compare these
with plain numpy. It also runs units that cannot be traced. The solvers are scipy's, or compiled and checked by scipy's.
The cache keeps a solution by all that decides it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from ctypes import PyDLL, c_double, c_void_p
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from typing import Any

import casadi as ca
import numpy as np
import scipy

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, load_or_make, store
from vdfmu.base.compile import SHOWN, loaded
from vdfmu.base.errors import LOG, FmuError, KernelError, UsageError
from vdfmu.base.platforms import native_available
from vdfmu.base.sources import source_digest
from vdfmu.compiler.c.text import c_prototype, elementary_files, setting_lines
from vdfmu.compiler.functions.traced import renamed
from vdfmu.compiler.unit.evaluate import Call, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.compiled import Repeated, source_key
from vdfmu.system.reference.solution import SHORT, ContinuousReference, SampledReference
from vdfmu.system.reference.wired import Action, Carry, Node, Run, TimeSetter, WiredUnits
from vdfmu.system.scenario.scenario import Variables

REPEATED = 100
"""Smallest number of intervals of a compiled solution that scipy also solves."""
BLOCK = 1024
"""Rows of a block, which is the part of a long run in memory."""
RESOLUTION: float = SHORT["atol"]
"""Smallest error of a position [rad or m] that a reference can resolve."""
_KEPT = 2**24
"""Largest cached solution [byte]."""


@dataclass(frozen=True)
class Reference:
    """Solution at the communication points: `t` (m,), and the outputs, ``unit.group``, (m, size) each.

    As in a co-simulation, row k has the outputs of the step that ends at t_k, and row 0 those at the start.
    """

    name: str
    t: Floats
    signals: dict[str, Floats]
    repeated: Repeated = field(default_factory=Repeated)
    """Intervals so far that both the compiled solver and scipy solved."""
    repeat: Callable[[int], None] = lambda row: None
    """Solves the interval that ends at a row again with scipy if compiled code solved it."""

    def __getitem__(self, name: str) -> Floats:
        """Return the values (m, size) of ``unit.group``."""
        return self.signals[name]


def reference_blocks(
    name: str, description: SystemDescription, *, step: float, stop: float, substeps: int = 1,
    groups: Sequence[str] | None = None, overlap: int = 0, progress: Callable[[int, int], None] | None = None,
) -> Iterator[Reference]:  # fmt: skip
    """Compute a reference in blocks of `BLOCK` communication points. The last may be shorter.

    Each begins with the last `overlap` points before it, as in :meth:`vdfmu.engine.results.recorded.Recorded.blocks`.

    A system without events is solved in compiled code, if there is a compiler. At least `REPEATED` intervals, evenly
    spaced, are solved by scipy too, and the row of each block that :attr:`Reference.repeat` is called with. VdfmuError
    if they differ by more than the tolerance.

    A sampled reference holds outputs over `substeps` equal parts of a `step` [s]. `groups` are the outputs,
    ``unit.group``, by default all. `progress` is called with the number of finished steps and their total.

    Raises
    ------
    UsageError
        For an unknown name, or a system with an algebraic loop or an FMU of another tool.
    VdfmuError
        If scipy finds no solution.
    """
    if name not in ("sampled", "sampled-delayed", "continuous"):
        raise UsageError(f"no reference {name!r}; there are sampled, sampled-delayed and continuous.")
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)
    shown = _shown_outputs(description.tables, groups)
    path = kept = None
    if t.size * sum(map(len, shown.values())) * t.itemsize <= _KEPT and (key := _key(description)):
        facts = (name, substeps, step, m, [*shown], key)
        path = cache_folder() / "references" / sha256(repr(facts).encode()).hexdigest()
        kept = load(path, lambda content: np.frombuffer(content).reshape(t.size + 2, sum(map(len, shown.values()))))
    repeated, repeat = Repeated(), None
    if kept is None:
        solved_blocks, solution = _solved(name, description, step / substeps, m * substeps, substeps, shown)
        repeated, repeat = solution.repeated, solution.repeat
    else:
        repeated = Repeated(int(kept[0, 0]), float(kept[1, 0]))
        solved_blocks = (kept[2 + first : 2 + first + BLOCK] for first in range(0, m + 1, BLOCK))
    ends = np.cumsum([len(nodes) for nodes in shown.values()]).tolist()
    where = {group: slice(end - len(shown[group]), end) for group, end in zip(shown, ends, strict=True)}
    blocks: list[Floats] = []
    before: Floats = np.empty((0, ends[-1] if ends else 0))
    apart = max(1, m // REPEATED)
    for first, new in zip(range(0, m + 1, BLOCK), solved_blocks, strict=True):
        block = np.concatenate([before, new])
        begin, end = first - len(before), min(first + BLOCK, m + 1)
        if path is not None and kept is None:
            blocks.append(new)
        signals = {group: block[:, columns] for group, columns in where.items()}
        solved = Reference(name, t[begin:end], signals, repeated)
        if repeat is not None:
            for row in range(-(-max(first, 1) // apart) * apart, end, apart):
                repeat(end - 1 - row)
            solved = replace(solved, repeat=partial(_repeat, repeat, len(before), len(block)))
        yield solved
        before = block[max(0, len(block) - overlap) :]
        if progress is not None:
            progress(min(first + BLOCK, m), m)
    if path is not None and blocks:
        facts = np.zeros((2, blocks[0].shape[1]))
        facts[:, 0] = repeated.intervals, repeated.difference
        store(path, np.concatenate([facts, *blocks]).tobytes())


def _repeat(repeat: Callable[[int], None], overlap: int, rows: int, row: int) -> None:
    """Solve the interval before a row of a block again, unless it belongs to the previous block or to the start."""
    if row >= max(overlap, 1):
        repeat(rows - 1 - row)


def reference(name: str, description: SystemDescription, *, step: float, stop: float) -> Reference:
    """Compute a whole reference. See :func:`reference_blocks`."""
    # a single block with all points
    *_, whole = reference_blocks(name, description, step=step, stop=stop, overlap=round(stop / step))
    return whole


def _key(description: SystemDescription) -> str:
    """Return all that determines a solution as text: code, connections, values, versions. Empty with Python units."""
    facts: list[Any] = [scipy.__version__, source_digest("system.reference"), source_key(), native_available()]
    facts.append(description.connections)
    facts += [table.digest for table in read_inputs(description.scenario.inputs, description.scenario.input_hold)]
    for name, table in description.tables.items():
        if not isinstance(table, Interface) or table.unit.backend == "python":
            return ""
        memory = table.memory_of(description.values[name])
        facts += [name, table.functions.identity, sha256(memory.tobytes()).hexdigest()]
    return repr(facts)


def _solved(
    name: str, description: SystemDescription, step: float, n: int, every: int, shown: Mapping[str, Sequence[Node]]
) -> tuple[Iterator[Floats], SampledReference | ContinuousReference]:
    """Return the shown outputs at each `every`-th of n + 1 times, block by block, and the solver."""
    system = WiredUnits(description)
    solution = (
        ContinuousReference(system) if name == "continuous" else SampledReference(system, name == "sampled-delayed")
    )
    places = system.places(node for nodes in shown.values() for node in nodes)
    system.start()
    times: Floats = step * np.arange(n + 1, dtype=np.float64)
    run = runs(system, solution.lists, sources(system, solution.lists))
    if name == "continuous":
        times, every = times[::every].copy(), 1
    return solution.blocks(times, run, every, BLOCK, places), solution


def runs(
    system: WiredUnits, lists: Mapping[str, Sequence[Action]], files: Mapping[str, bytes] | None
) -> dict[str, Run]:
    """Return a function for each list of actions, compiled from :func:`sources` or in Python."""
    if files is not None and native_available():
        with suppress(FmuError):  # such as a full disk
            # calls take less time than releasing the interpreter's lock
            library = loaded(files, "system", PyDLL)
            c_void_p.in_dll(library, "m").value = system.memory.ctypes.data
            functions: dict[str, Any] = {name: library[name] for name in lists}
            for function in functions.values():
                function.argtypes, function.restype = (c_double,), None
            return functions
    return {name: system.python(actions) for name, actions in lists.items()}


def sources(system: WiredUnits, lists: Mapping[str, Sequence[Action]]) -> dict[str, bytes] | None:
    """Return file name to C text of lists of actions; None if a unit has no C code."""
    code = Code(system)
    try:
        functions = [f"SHOWN {code.function(name, actions)}" for name, actions in lists.items()]
        files = {f"kernel_{name}.c": code.kernel(name) for name in code.called}
    except KernelError as error:  # an operation without C text, or a unit in plain Python
        LOG.info("the references run in Python: %s", error)
        return None
    prototypes = "".join(f"{c_prototype(made)};\n" for made in code.called.values())
    text = "\n".join(["#include <string.h>\n", SHOWN, "SHOWN double *m;", prototypes, *functions])
    files |= elementary_files() | {"system.c": text}
    return {name: content.encode() for name, content in files.items()}


class Code:
    """C text of actions. `called` are its traced functions."""

    head = "double t"
    unused = "(void)t;"

    def __init__(self, system: WiredUnits) -> None:
        self.system = system
        self.called: dict[str, ca.Function] = {}
        self._origins: dict[str, str] = {}
        """Called function to its identity."""
        self._taken: dict[str, ca.Function] = {}

    def function(self, name: str, actions: Sequence[Action]) -> str:
        """Return the function ``void name(double t)`` of the time, on a memory ``double *m``."""
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
        else:
            unit = self.system.units[action.unit]
            if not isinstance(unit, Traced):
                raise KernelError(f"{action.unit} has no traced functions.")
            for call in getattr(unit.interface.program, action.method):
                if unit.takes(call):  # choices are fixed: other calls are not compiled
                    yield from self.call(action.unit, unit, call)

    def call(self, name: str, unit: Traced, call: Call) -> Iterator[str]:
        """Yield the lines of a call."""
        interface, begin = unit.interface, self.system.begin(name)
        function = self.take(interface.functions.casadi_function(call.function))
        self._origins[function.name()] = f"{interface.functions.identity} {call.function}"
        names = (*function.name_in(), *function.name_out())
        places = {name: f"m + {begin + interface.arguments[call.group(name)].start}" for name in names}
        arguments = [places[name] for name in function.name_in()]
        made = [(key, places[key], function.numel_out(key), call.group(key) != key) for key in function.name_out()]
        yield from ("{", *(f"    {line}" for line in setting_lines(function.name(), arguments, made)), "}")

    def kernel(self, name: str) -> str:
        """Return the C text of a called function, cached because that of a long arm takes 1 s."""
        identity = self._origins[name]

        def make() -> bytes:
            from vdfmu.compiler.c.functions import kernel_source  # takes long to import

            return kernel_source(self.called[name]).encode()

        path = cache_folder() / "kernels" / sha256(repr((name, identity)).encode()).hexdigest()

        def read(content: bytes) -> str:
            if name.encode() not in content:
                raise ValueError(f"no function {name}")
            return content.decode()

        return load_or_make(path, make, read)

    def take(self, function: ca.Function) -> ca.Function:
        """Register a called function and return it, renamed if another robot's function has its name."""
        name, number = function.name(), 1
        while (first := self._taken.setdefault(name, function)) is not function:
            if first.serialize() == function.serialize():
                break
            number += 1
            name = f"{function.name()}_{number}"
        if name not in self.called:
            self.called[name] = first if name == first.name() else renamed(first, name)
        return self.called[name]


def _shown_outputs(tables: Mapping[str, Variables], groups: Sequence[str] | None) -> dict[str, list[Node]]:
    """Return the outputs of groups ``unit.group``, by default of all."""
    nodes: dict[str, list[Node]] = {}
    for name, table in tables.items():
        for i, variable in enumerate(table):
            group = f"{name}.{variable.group}"
            if variable.causality == "output" and (groups is None or group in groups):
                nodes.setdefault(group, []).append((name, i))
    return nodes
