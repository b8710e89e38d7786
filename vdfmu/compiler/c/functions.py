"""C text of traced functions, one C function each, from the instructions of the trace, and of tables.

CasADi's own generator puts a check for null around every access, and around each function an interface that a
solver asks for; here a function is what the equations are, with plain pointers, so that a compiler sees all of
it. The arithmetic is that of the trace, operation by operation.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.expressions import EXPRESSIONS, c_constant, c_prototype
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import find_loops
from vdfmu.compiler.c.text import source_text
from vdfmu.compiler.scalar.symbol import LOOKUP


def c_texts(function: ca.Function, apart: Collection[str] = (), joints: int = 0) -> list[str]:
    """Return a C11 function of a trace, as texts that can be compiled side by side; the last has the function itself.

    ``void name(const double *restrict argument, .., double *restrict result_out, ..)``, with a pointer for
    scalars too, matrices as in :class:`~vdfmu.compiler.functions.traced.KernelFunction`. It needs ``<math.h>``.

    The trace becomes loops over many `joints`, see :mod:`.loops`. Where these have too little in common, one of more
    than :data:`WHOLE` operations becomes a chain of functions ``name_part_1``, ..: the time in which compilers place
    variables in registers grows with the square of a function's length. The values are the same bits. Functions that it
    calls come before it, except those in `apart`.

    Raises
    ------
    KernelError
        If the trace has an operation that this module does not know.
    """
    if not function.is_a("SXFunction"):
        return _calling(function, apart, joints)
    loops = find_loops(function, joints)
    if loops is not None:
        return [c_loops(loops)]
    operations = operations_of(function)
    if len(operations) <= WHOLE:
        read = {name for operation in operations for name in operation.arguments}
        head = [f"(void){name};" for name in function.name_in() if name not in read]
        return [lookups(function) + _definition(c_prototype(function), operations, head, [])]
    first, *parts = _chain(function, operations)
    return [lookups(function) + first, *parts]


WHOLE = 18_000
"""Operations that go into one C function; the shipped arms have no longer trace."""
_PART = 1_000
"""Operations of one part of a longer trace."""
_LONG = 3_000
"""Operations from which a trace is long."""
_TOGETHER = 30
"""Parts that one compiler gets, which takes some 200 MB for them."""


def is_long(function: ca.Function, joints: int) -> bool:
    """Whether a trace has a text of its own where another calls it; of a long arm its part for ten joints decides."""
    return 10 * function.n_instructions() > _LONG * max(joints, 10)


def _calling(function: ca.Function, apart: Collection[str], joints: int) -> list[str]:
    """Return the texts of a function that only calls others: long ones each by itself, the last has the others."""
    places: dict[int, str] = {}  # part of CasADi's memory to the C name of what it holds
    sizes: dict[str, int] = {}
    callees: dict[str, ca.Function] = {}
    lines: list[str] = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            places[target[0]] = function.name_in(source[0])
        elif operation == ca.OP_OUTPUT:
            size = function.numel_out(target[0])
            name = f"{function.name_out(target[0])}_out"
            lines.append(f"memcpy({name}, {places[source[0]]}, {size} * sizeof(double));")
        elif operation == ca.OP_CALL:
            callee = function.instruction_MX(k).which_function()
            callees[callee.name()] = callee
            read = [places[i] for i in source]
            for i, place in enumerate(target):
                places[place] = f"v{len(sizes)}"
                sizes[places[place]] = callee.numel_out(i)
            lines.append(f"{callee.name()}({', '.join([*read, *(places[i] for i in target)])});")
        else:
            raise KernelError(f"{function.name()}: expected calls only, got operation {operation}.")
    declared = [f"double {name}[{size}];" for name, size in sizes.items()]
    body = "\n".join(f"    {line}" for line in (*declared, *lines))
    prototypes = "".join(f"{c_prototype(callee)};\n" for callee in callees.values())
    texts: list[str] = []
    together = [f"#include <string.h>\n\n{prototypes}"]
    for callee in callees.values():
        if callee.name() not in apart:
            (texts if is_long(callee, joints) else together).extend(c_texts(callee, joints=joints))
    return [*texts, "\n".join([*together, f"{c_prototype(function)}\n{{\n{body}\n}}\n"])]


def lookups(function: ca.Function) -> str:
    """Return the C functions of the tables that a trace looks rows up in."""
    return "".join(c_lookup(one) for one in function.find_functions(0) if one.name().startswith(LOOKUP))


def _chain(function: ca.Function, operations: list[Operation]) -> list[str]:
    """Return the texts of a long trace."""
    parts = [operations[i : i + _PART] for i in range(0, len(operations), _PART)]
    live: set[int] = set()  # values that later parts read
    texts: list[str] = []
    for number, part in reversed(list(enumerate(parts, 1))):
        written: set[int] = set()
        needed: set[int] = set()
        for operation in part:
            needed |= set(operation.reads) - written
            written |= set(operation.writes)
        load = [f"w{i} = w[{i}];" for i in sorted(needed)]
        keep = [f"w[{i}] = w{i};" for i in sorted(written & live)]
        read = {name for operation in part for name in operation.arguments}
        used = read | {name for operation in part for name in operation.results}
        names = (*function.name_in(), *(f"{name}_out" for name in function.name_out()))
        head = [f"(void){name};" for name in names if name not in used]
        prototype = _part_prototype(function, number)
        texts.append(f"{prototype};\n{_definition(prototype, part, [*head, '(void)w;', *load], keep)}")
        live = (live - written) | needed
    size = 1 + max(i for operation in operations for i in operation.writes)
    call = ", ".join((*function.name_in(), *(f"{name}_out" for name in function.name_out()), "w"))
    calls = "".join(f"    {function.name()}_part_{k}({call});\n" for k in range(1, len(parts) + 1))
    declared = "".join(f"{_part_prototype(function, k)};\n" for k in range(1, len(parts) + 1))
    texts.reverse()
    return [
        *("\n".join(texts[i : i + _TOGETHER]) for i in range(0, len(texts), _TOGETHER)),
        f"{declared}\n{c_prototype(function)}\n{{\n    double w[{size}];\n{calls}}}\n",
    ]


class Operation(NamedTuple):
    """One line of code: the values ``w`` that it reads and writes, and the arguments and results that it names."""

    text: str
    reads: tuple[int, ...] = ()
    writes: tuple[int, ...] = ()
    arguments: tuple[str, ...] = ()
    results: tuple[str, ...] = ()


def _row(function: ca.Function, argument: int, taken: Sequence[tuple[int, int]]) -> str:
    """Return the C text that looks a row up and takes numbers of it, place in it and value."""
    numbers = " ".join(f"w{i} = row[{j}];" for j, i in taken)
    return f"{{ double row[{function.numel_out(0)}]; {function.name()}(&w{argument}, row); {numbers} }}"


@dataclass(frozen=True)
class Language:
    """How a language writes the operations of a trace, whose values are ``w0``, ``w1``, .."""

    expressions: Mapping[int, str]
    """Operation to the pattern of its operands."""
    number: Callable[[float], str]
    argument: Callable[[str, int], str]
    """Text of an element of an argument, counted from 0."""
    result: Callable[[str, int], str]
    """Text of an element of a result."""
    row: Callable[[ca.Function, int, Sequence[tuple[int, int]]], str] = _row
    """Text that looks a row of a table up by a value, and takes numbers of it: place in it and value."""
    assignment: str = "{} = {};"


C = Language(EXPRESSIONS, c_constant, "{}[{}]".format, "{}_out[{}]".format)


def operations_of(function: ca.Function, language: Language = C) -> list[Operation]:
    """Return the operations of a trace, a line each."""
    arguments, results = function.name_in(), function.name_out()
    found: list[Operation] = []
    assign = language.assignment.format
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = tuple(function.instruction_input(k)), tuple(function.instruction_output(k))
        if operation == ca.OP_OUTPUT:
            name = results[target[0]]
            text = assign(language.result(name, target[1]), f"w{source[0]}")
            found.append(Operation(text, source[:1], results=(f"{name}_out",)))
        elif operation == ca.OP_CONST:
            value = language.number(function.instruction_constant(k))
            found.append(Operation(assign(f"w{target[0]}", value), (), target))
        elif operation == ca.OP_CALL:
            called = function.instructions_sx()[k].which_function()
            found.append(_call(called, source, target, language))
        elif operation == ca.OP_INPUT:
            name = arguments[source[0]]
            text = assign(f"w{target[0]}", language.argument(name, source[1]))
            found.append(Operation(text, (), target, arguments=(name,)))
        else:
            pattern = language.expressions.get(operation)
            if pattern is None:
                name = next(key for key, code in vars(ca).items() if key.startswith("OP_") and code == operation)
                raise KernelError(
                    f"{function.name()}: CasADi's operation {name} has no text in C. Write it with others, or write "
                    'backend = "python" in the class of the unit.'
                )
            value = pattern.format(*[f"w{i}" for i in source])
            found.append(Operation(assign(f"w{target[0]}", value), source, target))
    return found


def _call(called: ca.Function, source: tuple[int, ...], target: tuple[int, ...], language: Language) -> Operation:
    """Look up a row; what else a trace calls is a derivative of that, which is 0."""
    wanted = [(j, i) for j, i in enumerate(target) if i >= 0]
    writes = tuple(i for _, i in wanted)
    if not called.name().startswith(LOOKUP):
        zero = language.number(0.0)
        return Operation(" ".join(language.assignment.format(f"w{i}", zero) for i in writes), (), writes)
    return Operation(language.row(called, source[0], wanted), source[:1], writes)


def _definition(prototype: str, operations: list[Operation], head: list[str], tail: list[str]) -> str:
    used = sorted({i for operation in operations for i in (*operation.reads, *operation.writes)})
    declared = [f"double {', '.join(f'w{i}' for i in used)};"] if used else []
    first = [line for line in head if line.startswith("(void)")]
    lines = [*first, *declared, *(line for line in head if line not in first)]
    body = "\n".join(f"    {line}" for line in (*lines, *(o.text for o in operations), *tail))
    return f"{prototype}\n{{\n{body}\n}}\n"


def _part_prototype(function: ca.Function, number: int) -> str:
    head, _, arguments = c_prototype(function).partition("(")
    return f"{head}_part_{number}({arguments.removesuffix(')')}, double *restrict w)"


def c_lookup(function: ca.Function) -> str:
    """Return the C text of a table and the static function ``name(const double *x, double *row)`` that reads it.

    In a file that has it already it does nothing.
    """
    edges, rows = lookup_table(function)
    name, w = function.name(), function.numel_out(0)
    return f"""{source_text("lookup.h")}
#ifndef {name.upper()}
#define {name.upper()}
static const table_number {name}_edges[] = {{
{_listed(edges)}
}};
static const table_number {name}_rows[] = {{
{_listed(rows)}
}};

static void {name}(const double *x, double *row)
{{
    (void)x;
    for (int i = 0; i < LOOKUP_LANES; i++) {{
        const table_number *from = {name}_rows + {w} * lookup_place({name}_edges, {len(edges) - 1}, LANE(*x, i));
        for (int j = 0; j < {w}; j++)
            LANE(row[j], i) = from[j];
    }}
}}
#endif

"""


def lookup_table(function: ca.Function) -> tuple[list[float], list[float]]:
    """Return the edges of a table, and its rows one after the other."""
    constants = [k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CONST]
    edges, rows = (function.instruction_MX(k).to_DM().nonzeros() for k in constants)
    return edges, rows


def _listed(numbers: Iterable[float]) -> str:
    found = [repr(number) for number in numbers]
    return ",\n".join("    " + ", ".join(found[i : i + 5]) for i in range(0, len(found), 5))
