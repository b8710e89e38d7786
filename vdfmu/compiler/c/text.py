"""C text: expressions of the operations of a trace, prototypes, numbers, comments, tables and calls."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from functools import cache

import casadi as ca

from vdfmu.base.files import data_path, source_bytes
from vdfmu.compiler.functions.derivatives import derivative_names
from vdfmu.compiler.functions.operations import instructions

EXPRESSIONS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    **{
        getattr(ca, f"OP_{name.upper()}"): f"{name}({operands})"
        for names, operands in (
            ("sqrt sin cos tan asin acos atan", "{0}"),
            ("atan2", "{0}, {1}"),
            ("floor ceil tanh sinh cosh asinh acosh atanh", "{0}"),
            ("hypot", "{0}, {1}"),
            ("exp expm1 log log1p", "{0}"),
            ("fmod", "{0}, {1}"),
            ("fabs", "{0}"),
        )
        for name in names.split()
    },
    ca.OP_SIGN: "({0} > 0.0 ? 1.0 : 0.0) - ({0} < 0.0 ? 1.0 : 0.0)",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_FMIN: "fmin({0}, {1})",
    ca.OP_FMAX: "fmax({0}, {1})",
    ca.OP_LT: "{0} < {1} ? 1.0 : 0.0",
    ca.OP_LE: "{0} <= {1} ? 1.0 : 0.0",
    ca.OP_EQ: "{0} == {1} ? 1.0 : 0.0",
    ca.OP_NE: "{0} != {1} ? 1.0 : 0.0",
    ca.OP_NOT: "{0} == 0.0 ? 1.0 : 0.0",
    ca.OP_AND: "(({0} != 0.0) & ({1} != 0.0)) ? 1.0 : 0.0",
    ca.OP_OR: "(({0} != 0.0) | ({1} != 0.0)) ? 1.0 : 0.0",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}
"""Operation: C expression of its operands {0} and {1}: numbers or vectors (``fmu_src/batch/lanes.h``)."""
CALLED = frozenset(re.findall(r"\b(\w+)\(", " ".join(EXPRESSIONS.values())))
"""Functions in the expressions."""
_WIDTH = 110
_PLAIN = {*range(32, 127)} - {*b'?"\\'}  # no trigraphs
_BYTES = [chr(k) if k in _PLAIN else f"\\{chr(k)}" if k in b'"\\' else f"\\{k:03o}" for k in range(256)]
"""Text of each byte in a string literal."""


@cache
def slopes(operation: int) -> tuple[str, ...]:
    """Return the derivatives of an operation with respect to each operand, as C expressions of its operands."""
    pattern = EXPRESSIONS[operation]
    operands = [ca.SX.sym(name) for name in ("a", "b")[: 2 if "{1}" in pattern else 1]]
    made = (ca.SX.unary if len(operands) == 1 else ca.SX.binary)(operation, *operands)
    function = ca.Function("slopes", operands, [ca.densify(ca.jacobian(made, ca.vertcat(*operands)))])
    texts: dict[int, str] = {}
    derivatives = [""] * len(operands)
    for k, code, read, place in instructions(function):
        if code == ca.OP_OUTPUT:
            derivatives[place[1]] = texts[read[0]]
        elif code == ca.OP_INPUT:
            texts[place[0]] = f"{{{read[0]}}}"
        elif code == ca.OP_CONST:
            texts[place[0]] = c_constant(function.instruction_constant(k))
        else:
            texts[place[0]] = f"({EXPRESSIONS[code].format(*(texts[i] for i in read))})"
    return tuple(derivatives)


def c_prototype(function: ca.Function, ending: str = "") -> str:
    """Return the declaration of a traced function, or of a derivative, without semicolon."""
    arguments, results = derivative_names(function, ending) if ending else (function.name_in(), function.name_out())
    pointers = [f"const double *restrict {name}" for name in arguments]
    pointers += [f"double *restrict {name}_out" for name in results]
    return f"void {function.name()}{ending and f'_{ending}'}({', '.join(pointers)})"


def c_constant(value: float) -> str:
    """Return a number as C text."""
    if math.isnan(value):
        return "NAN"
    return repr(float(value)) if math.isfinite(value) else f"({'-' if value < 0 else ''}INFINITY)"


def comment(text: str) -> str:
    """Return a block comment."""
    text = text.replace("*/", "* /").replace("/*", "/ *").encode("ascii", "replace").decode()
    lines = textwrap.wrap(text, _WIDTH - 3) or [""]
    return "/* " + "\n * ".join(lines) + "\n */\n"


def string(text: str) -> str:
    """Return a string literal, with octal escapes of UTF-8 for bytes beyond ASCII."""
    content = "".join(_BYTES[byte] for byte in text.encode())
    return f'"{content}"'


def cell(*values: object) -> str:
    """Return an initializer of a structure."""
    return f"{{{', '.join(map(str, values))}}}"


def fields(items: Iterable[str], *, one_a_line: bool = False, indent: str = "    ") -> str:
    """Return items separated by commas, in lines of limited width."""
    lines: list[str] = []
    for item in items:
        if lines and not one_a_line and len(lines[-1]) + len(item) + 2 < _WIDTH:
            lines[-1] += f", {item}"
        else:
            if lines:
                lines[-1] += ","
            lines.append(indent + item)
    return "\n".join(lines)


def array(kind: str, name: str, items: Iterable[str], *, one_a_line: bool = False) -> str:
    """Return the definition of a constant array. C forbids empty arrays: without items it has a zero."""
    listed = fields(items, one_a_line=one_a_line) or "    0"
    return f"static const {kind} {name}[] = {{\n{listed}\n}};\n"


def head(content: str) -> str:
    """Return the first comment of a generated file."""
    # no version and no parameter values, so that files of equal content are compiled once
    return comment(f"{content} Generated by vdfmu; do not edit.")


@cache
def source_text(name: str) -> str:
    """Return the text of a file of ``fmu_src/functions``, C for traced functions."""
    return source_bytes(data_path("fmu_src") / "functions" / name).decode()


def elementary_files() -> dict[str, str]:
    """Return file name to text for the elementary functions that the C of a trace calls."""
    return {name: source_text(name) for name in ("elementary.h", "one_number.h")}


def indented(opening: str, lines: Iterable[str], closing: str = "}") -> list[str]:
    """Return lines between an opening and a closing line."""
    return [opening, *(f"    {line}" for line in lines), closing]


def definition(prototype: str, lines: Iterable[str]) -> str:
    """Return the definition of a function."""
    return "\n".join([prototype, *indented("{", lines), ""])


def call_lines(name: str, places: Sequence[str]) -> list[str]:
    """Return the lines of a call."""
    lines = [f"{name}("]
    for i, place in enumerate(places):
        item = place + (", " if i < len(places) - 1 else ");")
        if len(lines[-1]) + len(item) > 106:
            lines.append("    ")
        lines[-1] += item
    return [line.rstrip() for line in lines]


def setting_lines(name: str, arguments: Sequence[str], made: Sequence[tuple[str, str, int, bool]]) -> list[str]:
    """Return the lines of a call that writes its results to a memory.

    `made` has name, place and size of each result, and whether the call may read the place. If it may, the result is
    copied after the call.
    """
    lines = call_lines(name, [*arguments, *(result if read else place for result, place, _, read in made)])
    if copied := [(result, place, size) for result, place, size, read in made if read]:
        declared = fields((f"{result}[{size}]" for result, _, size in copied), indent="")
        lines = [*f"double {declared};".splitlines(), *lines]
    return lines + [f"memcpy({place}, {result}, {size} * sizeof(double));" for result, place, size in copied]


def wrapped(prototype: str) -> str:
    """Return a prototype in lines of limited width."""
    name, _, arguments = prototype.partition("(")
    return "\n".join(call_lines(name, arguments.removesuffix(")").split(", "))).removesuffix(";")
