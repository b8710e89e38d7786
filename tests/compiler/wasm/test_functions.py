"""Traced functions as WebAssembly, in wasmtime: single operations and whole functions have the bits of CasADi."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest
import wasmtime

from tests.compiler.wasm.linked import linked
from tests.conftest import heavy
from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.functions import lookup_table
from vdfmu.compiler.c.text import EXPRESSIONS
from vdfmu.compiler.scalar.symbol import LOOKUP
from vdfmu.compiler.wasm import IMPORTED, INTEGER, NUMBER, OPERATIONS, Assembler
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.wired import WiredUnits
from vdfmu.system.scenario import load_scenario

TYPES = {INTEGER: wasmtime.ValType.i32, NUMBER: wasmtime.ValType.f64}
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.75, 1e-300, 1e300, math.inf, -math.inf, math.nan]


class Instance:
    """The functions of traces in a module; with `own` it calls functions of the C library of this machine."""

    def __init__(self, functions: Sequence[ca.Function], own_library: bool = True) -> None:
        assembler = Assembler()
        exported = {f"f{k}": assembler.traced(function) for k, function in enumerate(functions)}
        self.functions, self.place = functions, assembler.room(200_000)
        self.store, linker = linked(assembler.growth)
        if own_library:
            linker.allow_shadowing = True
            for name, function in self._called(functions):
                arguments, results = ([TYPES[bytes([code])]() for code in kind] for kind in IMPORTED[name])
                kind = wasmtime.FuncType(arguments, results)
                linker.define(self.store, "base", name, wasmtime.Func(self.store, kind, function))
        self.memory = linker.get(self.store, "base", "memory")
        module = wasmtime.Module(self.store.engine, assembler.module(exported))
        self.exports = linker.instantiate(self.store, module).exports(self.store)

    def _called(self, functions: Sequence[ca.Function]) -> Iterator[tuple[str, Callable[..., Any]]]:
        symbols = ca.SX.sym("x"), ca.SX.sym("y")
        for name in IMPORTED.keys() - {"table_row", "move_unit"}:
            operation = next(key for key, pieces in OPERATIONS.items() if name in pieces)
            arguments = symbols[: len(IMPORTED[name][0])]
            made = (ca.SX.unary if len(arguments) == 1 else ca.SX.binary)(operation, *arguments)
            called = ca.Function(name, arguments, [made])
            yield name, lambda *a, called=called: float(called(*a))
        tables = [inner for f in functions for inner in f.find_functions() if inner.name().startswith(LOOKUP)]
        edges = np.array(lookup_table(tables[0])[0]) if tables else np.zeros(2)
        yield "table_row", lambda _, n, x: int(np.clip(np.searchsorted(edges, x, "right") - 1, 0, n - 1))

    def __call__(self, k: int, *arguments: np.ndarray) -> list[np.ndarray]:
        """Call a function with values of its arguments."""
        function, memory, at = self.functions[k], self.memory, self.place
        addresses = []
        for values in arguments:
            content = np.ascontiguousarray(values, dtype="<f8").tobytes()
            memory.write(self.store, content, at)
            addresses.append(at)
            at += len(content)
        sizes = [8 * function.numel_out(i) for i in range(function.n_out())]
        results = [at + sum(sizes[:i]) for i in range(len(sizes))]
        self.exports[f"f{k}"](self.store, *addresses, *results)
        contents = [memory.read(self.store, at, at + size) for at, size in zip(results, sizes, strict=True)]
        return [np.frombuffer(bytes(content), "<f8") for content in contents]


def expected(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    inputs = [values.reshape(function.size_in(i), order="F") for i, values in enumerate(arguments)]
    return [np.array(result.full()).ravel(order="F") for result in function.call(inputs)]


def assert_same_bits(actual: np.ndarray, values: np.ndarray, where: str) -> None:
    np.testing.assert_array_equal(np.isnan(actual), np.isnan(values), err_msg=where)  # whose bits no standard fixes
    rest = ~np.isnan(values)
    np.testing.assert_array_equal(actual[rest].view(np.int64), values[rest].view(np.int64), err_msg=where)


def operation_functions() -> dict[int, ca.Function]:
    functions = {}
    for key, pieces in OPERATIONS.items():
        symbols = [ca.SX.sym(name) for name in "xy"[: 2 if 1 in pieces else 1]]
        made = (ca.SX.binary if len(symbols) == 2 else ca.SX.unary)(key, *symbols)
        functions[key] = ca.Function(f"operation_{key}", symbols, [made])
    return functions


def test_there_is_code_of_each_operation_that_has_c():
    assert OPERATIONS.keys() == EXPRESSIONS.keys()


@pytest.mark.parametrize("own_library", [True, *heavy(False)])
def test_an_operation_has_the_bits_of_casadi(own_library):
    functions = operation_functions()
    instance = Instance(list(functions.values()), own_library)
    for k, (key, function) in enumerate(functions.items()):
        exact = own_library or not any(isinstance(piece, str) for piece in OPERATIONS[key])
        for x in SPECIAL:
            for y in SPECIAL if function.n_in() == 2 else [0.0]:
                inputs = [np.array([x]), np.array([y])][: function.n_in()]
                (actual,), (value,) = instance(k, *inputs), expected(function, *inputs)
                if key == ca.OP_SIGN:  # CasADi has the sign of -0 and of NaN; this is the C of the FMUs
                    value = np.array([float(x > 0.0) - float(x < 0.0)])
                if exact:
                    assert_same_bits(actual, value, f"{function} {inputs}")
                else:  # another C library: both are within two units in the last place
                    np.testing.assert_allclose(
                        actual, value, rtol=4 * 2.3e-16, atol=0.0, err_msg=f"{function} {inputs}"
                    )


def test_an_operation_without_code_is_said():
    x = ca.SX.sym("x")
    with pytest.raises(KernelError, match=r"^wrong: CasADi's operation \d+ is not supported in WebAssembly\.$"):
        Assembler().traced(ca.Function("wrong", [x], [ca.erf(x)]))


@pytest.mark.parametrize("scenario", ["kr300", *heavy("screw", "tracking", "estimation")])
def test_the_units_of_a_scenario_have_the_bits_of_casadi(scenario):
    """Start, outputs, derivatives, updates and steps of the solver, with random numbers."""
    system = WiredUnits(SystemDescription(load_scenario(scenario)))
    random = np.random.default_rng(2)
    for name, unit in system.units.items():
        program = unit.interface.program
        calls = [call for call in (*program.calls, *program.step, *program.left) if unit.takes(call)]
        functions = [unit.interface.functions.casadi_function(call.function) for call in calls]
        instance = Instance(functions)
        for k, function in enumerate(functions):
            inputs = []
            for group in function.name_in():
                size, where = function.numel_in(group), unit.interface.arguments.get(group)
                typical = np.full(size, 1e-3) if where is None else unit.memory[where]
                inputs.append(typical * random.uniform(0.9, 1.1, size) + 1e-3 * random.uniform(size=size))
            for actual, value in zip(instance(k, *inputs), expected(function, *inputs), strict=True):
                assert_same_bits(actual, value, f"{name} {function.name()}")


def test_functions_of_vectors_have_the_bits_of_casadi():
    """Calls, slices, columns, constants, and elementwise operations with a scalar among vectors."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b")
    inner = ca.Function("inner", [a, b], [a * b, ca.sin(a[1]) + b], ["a", "b"], ["c", "d"])
    x, y = ca.MX.sym("x", 5), ca.MX.sym("y", 3)
    c, d = inner(x[1:3], y[2])
    e, _ = inner(c, d)
    moved = ca.fmax(2.0 * ca.vertcat(c, e), y[0]) - ca.MX(ca.DM([0.5, 1.5, 0.0, -2.0]))
    put = ca.MX(y)
    put[[2, 0]] = x[1:3]
    results = [ca.vertcat(moved, x[[4, 0]]), ca.sqrt(ca.sumsqr(moved)), x[2:4], put]
    function = ca.Function("vectors", [x, y], results, ["x", "y"], ["u", "v", "w", "z"])
    instance = Instance([function])
    rng = np.random.default_rng(3)
    for _ in range(2):  # the second time with what the first has left in memory
        arguments = [rng.uniform(-2.0, 2.0, 5), rng.uniform(-2.0, 2.0, 3)]
        for actual, expected in zip(instance(0, *arguments), function.call(arguments), strict=True):
            np.testing.assert_array_equal(actual, expected.full().ravel())
    with pytest.raises(KernelError, match="operation .* is not supported in WebAssembly"):
        Assembler().traced(ca.Function("norm", [x], [ca.norm_1(x)]))
