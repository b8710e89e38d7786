"""Algorithm code: the program of a block in GALEC, the language of eFMI for embedded control."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import casadi as ca

from vdfmu.compiler.c.functions import Language, operations_of
from vdfmu.compiler.c.grouping import in_few_places
from vdfmu.compiler.c.text import EXPRESSIONS, indented
from vdfmu.compiler.unit.trace import Call
from vdfmu.extras.efmi.block import FIRST, PERIOD, STEPS, BlockVariable, SampledBlock

_TRUTHS = {
    **{k: EXPRESSIONS[k].removesuffix(" ? 1.0 : 0.0") for k in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NOT)},
    ca.OP_NE: "{0} <> {1}",
    ca.OP_AND: "{0} <> 0.0 and {1} <> 0.0",
    ca.OP_OR: "{0} <> 0.0 or {1} <> 0.0",
}
_OTHERS = {
    ca.OP_POW: "{0} ^ {1}",
    ca.OP_CONSTPOW: "{0} ^ {1}",
    ca.OP_FLOOR: "roundDown({0})",
    ca.OP_CEIL: "roundUp({0})",
    ca.OP_ASINH: "sign({0}) * ln(absolute({0}) + sqrt({0} * {0} + 1.0))",
    ca.OP_ACOSH: "ln({0} + sqrt({0} * {0} - 1.0))",
    ca.OP_ATANH: "0.5 * ln((1.0 + {0}) / (1.0 - {0}))",
    ca.OP_HYPOT: "sqrt({0} * {0} + {1} * {1})",
    ca.OP_EXPM1: "exp({0}) - 1.0",
    ca.OP_LOG: "ln({0})",
    ca.OP_LOG1P: "ln(1.0 + {0})",
    ca.OP_FMOD: "realRemainderTowardsZero({0}, {1})",
    ca.OP_FABS: "absolute({0})",
    ca.OP_SIGN: "sign({0})",
    ca.OP_COPYSIGN: "(if {1} < 0.0 then -absolute({0}) else absolute({0}))",
    ca.OP_FMIN: "min({0}, {1})",
    ca.OP_FMAX: "max({0}, {1})",
    ca.OP_IF_ELSE_ZERO: "(if {0} <> 0.0 then {1} else 0.0)",
}
GALEC_EXPRESSIONS = EXPRESSIONS | {k: f"(if {text} then 1.0 else 0.0)" for k, text in _TRUTHS.items()} | _OTHERS
"""Operation to its text, which is C unless GALEC's syntax differs."""

_INFINITE = "not isFinite({0})"


def galec_number(value: float) -> str:
    """Return a number, always with a decimal point."""
    if not math.isfinite(value):
        return "nan()" if math.isnan(value) else "plusInfinite()" if value > 0.0 else "minusInfinite()"
    digits, e, exponent = repr(float(value)).partition("e")
    return digits + ("" if "." in digits else ".0") + e + exponent


def galec_value(v: BlockVariable, value: float) -> str:
    """Return a value of a variable."""
    if v.type == "Real":
        return galec_number(value)
    return str(int(value)) if v.type == "Integer" else str(bool(value)).lower()


def galec_name(v: BlockVariable) -> str:
    """Return the name of a variable."""
    return f"'previous({v.name})'" if v.before else v.name


def galec_text(block: SampledBlock) -> str:
    """Return the program."""
    lines = [
        f"block {block.name}",
        *map(_declaration, block.of("input", "output", "tunableParameter")),
        "protected",
        *map(_declaration, block.of("constant", "state")),
        "public",
        *_method("Startup", [], _startup(block)),
        *_method("Recalibrate", ["    signals INVALID_ARGUMENT;"] if block.tunable else [], _recalibrate(block)),
        *_step(block),
        f"end {block.name};\n",
    ]
    return "\n".join(lines)


def _declaration(v: BlockVariable) -> str:
    kind = {"tunableParameter": "parameter ", "state": ""}.get(v.causality, f"{v.causality} ")
    return f"    {kind}{v.type} {galec_name(v)}{f'[{v.size}]' if v.size else ''};"


def _method(name: str, before: Sequence[str], lines: Iterable[str]) -> list[str]:
    body = [f"        {line}" for line in lines]
    return [f"    method {name}", *(f"    {line}" for line in before), "    algorithm", *body, f"    end {name};"]


def _startup(block: SampledBlock) -> Iterator[str]:
    for v in block.of("output", "tunableParameter", "constant", "state"):
        values = ", ".join(galec_value(v, value) for value in v.start)
        yield f"self.{galec_name(v)} := {f'{{{values}}}' if v.size else values};"


def _recalibrate(block: SampledBlock) -> Iterator[str]:
    for v, bounds in block.tunable:
        broken = [_INFINITE, *(f"{{0}} {sign} {galec_number(bound)}" for sign, bound in bounds)]
        yield from _each(v, " or ".join(broken), ["signal INVALID_ARGUMENT;"])


def _each(v: BlockVariable, broken: str, then: Sequence[str]) -> list[str]:
    """Return lines that run if a condition holds for an element of a variable."""
    element = f"self.{galec_name(v)}{'[i]' if v.size else ''}"
    lines = _when(broken.format(element), then)
    return indented(f"for i in 1:{v.size} loop", lines, "end for;") if v.size else lines


def _when(condition: str, lines: Iterable[str]) -> list[str]:
    return indented(f"if {condition} then", lines, "end if;")


def _step(block: SampledBlock) -> list[str]:
    """Return the lines of DoStep."""
    values = 0

    def lines(calls: Sequence[Call]) -> Iterator[str]:
        nonlocal values
        for call in calls:
            function = block.interface.functions.casadi_function(call.function)
            texts, count = in_few_places(operations_of(function, _language(block, call)))
            values = max(values, count)
            yield from texts

    def check(variables: Iterable[BlockVariable]) -> list[str]:
        return [line for v in variables for line in _each(v, _INFINITE, ["signal NAN;", "valid := false;"])]

    body: list[str] = []
    states = [v for v in block.variables if v.before]
    if block.has_time:
        body += [f"t := real(self.{STEPS});", f"t := t * self.{PERIOD};", f"self.{STEPS} := self.{STEPS} + 1;"]
    body += ["valid := true;", *check(block.of("input", "tunableParameter"))]
    if block.start:
        body += _when(f"valid and self.{FIRST}", [*lines(block.start), *check(states)])
    first = [f"self.{FIRST} := false;"] * bool(block.start)
    body += _when("valid", [*first, *lines(block.update), *lines(block.outputs), *check(block.of("output"))])
    if states:
        body += _when("valid", [f"self.{galec_name(v)} := self.{v.name};" for v in states])
    local = [f"    Real w{i};" for i in range(values)] + ["    Real t;"] * block.has_time + ["    Boolean valid;"]
    local += ["    Integer place;"] * any(line.startswith("place := ") for line in body)
    return _method("DoStep", ["    signals NAN;", "protected", *local], body)


def _language(block: SampledBlock, call: Call) -> Language:
    def element(name: str, k: int) -> str:
        if name == "t":
            return "t"
        group = block.named(call.group(name))
        shown = f"'previous({group})'" if name == call.group(name) and block.is_before(call, name) else group
        return f"self.{shown}[{k + 1}]" if block.sizes[group] else f"self.{shown}"

    def row(function: ca.Function, argument: str, taken: Sequence[tuple[int, str]]) -> str:
        name, width = function.name(), function.numel_out(0)
        last = block.sizes[f"{name}_edges"] - 2
        search = f"if {argument} >= self.{name}_edges[i + 1] then place := i; end if;"
        numbers = (f"{value} := self.{name}_rows[place * {width} + {j + 1}];" for j, value in taken)
        return " ".join([f"place := 0; for i in 1:{last} loop {search} end for;", *numbers])

    return Language(GALEC_EXPRESSIONS, galec_number, element, element, row, assignment="{} := {};")
