"""C files of traced functions: one C function each, from the instructions of the trace, and tables.

The arithmetic is the trace, operation by operation, on plain pointers. CasADi's own code generator would add a null
check to every access and a solver's interface to each function.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from types import MappingProxyType

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.base.cache import cache_folder, cached_per_command, load_or_make
from vdfmu.base.errors import KernelError
from vdfmu.base.sources import source_digest
from vdfmu.compiler.c.calls import VectorText
from vdfmu.compiler.c.grouping import Operation, in_few_places, short_lines
from vdfmu.compiler.c.operations import c_derivatives, c_operations, has_table
from vdfmu.compiler.c.text import EXPRESSIONS, c_constant, c_prototype, definition, head, source_text, wrapped
from vdfmu.compiler.functions.chain import LOCAL
from vdfmu.compiler.functions.derivatives import DIRECTIONS, has_roundings, lookup_table, matrix_numbers, matrix_of
from vdfmu.compiler.functions.operations import instructions
from vdfmu.compiler.functions.traced import renamed
from vdfmu.compiler.scalar.symbol import LOOKUP, MATRIX

_MOST_IN_C = 1_700
"""Most operations of a function whose derivatives, three times as long, are written in C.

Longer ones are tables, see :mod:`.operations`, because importers rarely call derivatives, and those of a feedforward
took 4 s to compile. The paper's plant is below the limit, since an importer's implicit solver may call its derivatives.
"""
_DEFINED = re.compile(r"^void (\w+)\([^;{]*\)\n{", re.MULTILINE)
"""Definition of a function, with its name."""


Derivatives = Mapping[str, Callable[[], ca.Function]]
"""Direction of a derivative to the function that traces it."""


def kernel_files(
    function: ca.Function, apart: Collection[str] = (), derivatives: Derivatives = MappingProxyType({})
) -> dict[str, str]:
    """Return file name to text of a traced function and its derivatives, without its callees in `apart`.

    The texts are cached under the function and the compiler's sources.
    """
    key = source_digest("compiler"), function.serialize(), sorted(apart), [*derivatives]
    place = cache_folder() / "texts" / sha256(repr(key).encode()).hexdigest()
    files = load_or_make(place, lambda: json.dumps(_written(function, apart, derivatives)).encode(), _texts)
    return files | (c_operations() if any(_TABLES in text for text in files.values()) else {})


def _texts(content: bytes) -> dict[str, str]:
    """Return file name to text from an entry of the cache; ValueError for anything else."""
    texts = json.loads(content)
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise ValueError("no texts of files")
    return texts


_TABLES = '#include "operations.h"'
"""Line in files with tables, which need the runner."""


def _written(function: ca.Function, apart: Collection[str], derivatives: Derivatives) -> dict[str, str]:
    """Write the files of :func:`kernel_files` without the runner of tables."""
    texts = c_texts(function, apart)
    name = f"kernel_{function.name()}"
    top = head(f"The traced function {function.name()}, operation by operation.") + '#include "elementary.h"\n'
    files = {f"{name}_part_{k}.c": f"{top}\n{text}" for k, text in enumerate(texts[:-1], 1)}
    files[f"{name}.c"] = f"{top}\n{wrapped(c_prototype(function))};\n\n{texts[-1]}"
    for callee in function.find_functions(0):
        if (matrix := matrix_of(callee)) is not None and not matrix[1]:
            about = head("Products with a matrix in the traced functions.") + '#include "elementary.h"\n\n'
            files[f"kernel_{matrix[0]}.c"] = about + _matrix(matrix[0], matrix_numbers(callee))
    if not derivatives:
        return files
    about = head(f"Derivatives of the traced function {function.name()}.") + '#include "elementary.h"\n'
    if (
        function.is_a("SXFunction")
        and function.n_instructions() > _MOST_IN_C
        and has_table(function)
        and not has_roundings(function)
    ):
        return files | {f"{name}_forward_reverse.c": f"{about}{_TABLES}\n\n{c_derivatives(function)}"}
    shared = {_name_in_c(function, callee.name()) for callee in function.find_functions(0)}
    for ending, derivative in derivatives.items():
        texts = [f"{wrapped(c_prototype(function, ending))};", "", *c_texts(derivative(), shared)]
        files[f"{name}_{ending}.c"] = "\n".join([about, *texts])
    return files


def avx2_copies(files: Mapping[str, str]) -> dict[str, str]:
    """Return files that compile the files of the step again for AVX2, with renamed functions."""
    names = _DEFINED.findall("\n".join(files.values()))
    defines = "".join(f"#define {name} {name}_avx2\n" for name in names)
    return {
        file.replace(".c", "_avx2.c"): head(f"{file} once more, for processors with AVX2; see processor.h.")
        + source_text("avx2.c").replace("/* RENAMED */\n", defines + "\n").replace("FILE", file)
        for file in files
    }


def kernel_source(function: ca.Function) -> str:
    """Return the C text of a traced function in one file, see :func:`kernel_files`. It is made once per job."""
    sources = _sources()
    if function not in sources:
        text = "\n".join(kernel_files(function).values())
        sources[function] = text.replace(f"{_PRODUCT} {MATRIX}", f"INLINE {_PRODUCT} {MATRIX}")
    return sources[function]


@cached_per_command
def _sources() -> dict[ca.Function, str]:
    """Return the texts of the functions of a job. FMUs and references share them, and so their objects."""
    return {}


def c_texts(function: ca.Function, apart: Collection[str] = ()) -> list[str]:
    """Return the C11 function of a trace, as texts that can be compiled in parallel. The last defines the function.

    ``void name(const double *restrict argument, .., double *restrict result_out, ..)``, with a pointer for
    scalars too, matrices as in :class:`~vdfmu.compiler.functions.traced.KernelFunction`. It needs ``elementary.h``.

    Callees come first, except for those in `apart`. KernelError for an unknown operation.
    """
    if not function.is_a("SXFunction"):
        return _calling(function, apart)
    operations = short_lines(operations_of(function), group=_RARE.search(function.name()) is None)
    read = {name for operation in operations for name in operation.arguments}
    lines = [f"(void){name};" for name in function.name_in() if name not in read]
    texts, count = in_few_places(operations)
    lines += [f"double {', '.join(f'w{i}' for i in range(count))};", *texts] if count else texts
    return [called_tables(function) + definition(c_prototype(function), lines)]


_RARE = re.compile(r"_(fwd|adj)1_")
"""Part of the name of a pass's derivative. It is compiled without optimisation, so grouped calls would gain little."""
_LONG = 3_000
"""Most operations of a callee that has no separate text."""


def _calling(function: ca.Function, apart: Collection[str]) -> list[str]:
    """Return the texts of a function of vectors: one for each long callee, then the rest."""
    callees: dict[str, ca.Function] = {}
    for k, operation, *_ in instructions(function):
        if operation == ca.OP_CALL:
            callee = function.instruction_MX(k).which_function()
            callees[callee.name()] = callee
    names = {name: _name_in_c(function, name) for name in callees}
    named = [callee if names[name] == name else renamed(callee, names[name]) for name, callee in callees.items()]
    texts: list[str] = []
    together = ["#include <string.h>\n", *(f"{c_prototype(callee)};" for callee in named), ""]
    for callee in named:
        if callee.name() not in apart:
            *parts, text = c_texts(callee, apart)
            texts += parts
            (texts if callee.n_instructions() > _LONG else together).append(text)
    return [*texts, "\n".join([*together, definition(c_prototype(function), VectorText(function, names).lines())])]


def _name_in_c(function: ca.Function, callee: str) -> str:
    """Return the C name of a function that another calls; for a pass it contains the name of its chain."""
    before, is_local, rest = callee.partition(LOCAL)
    if not is_local:
        return callee
    name = function.name()
    for ending in DIRECTIONS:
        name = name.removesuffix(f"_{ending}")
    return f"{name}_{before}{rest}"


def called_tables(function: ca.Function) -> str:
    """Return the C functions of the tables of a trace, and prototypes of products with large matrices."""
    called = function.find_functions(0)
    names = dict.fromkeys(matrix[0] for matrix in map(matrix_of, called) if matrix is not None)
    prototypes = (f"{_PRODUCT} {name}{ending}({_FACTORS});\n" for name in names for ending in ("", "_back"))
    return "".join([*(_lookup(each) for each in called if each.name().startswith(LOOKUP)), *prototypes])


def _row(function: ca.Function, argument: str, taken: Sequence[tuple[int, str]]) -> str:
    """Return the C text that looks up a row and copies some of its numbers, given by place in the row and value."""
    numbers = " ".join(f"{value} = v0[{j}];" for j, value in taken)
    return f"{{ double v0[{function.numel_out(0)}], v1 = {argument}; {function.name()}(&v1, v0); {numbers} }}"


def _product(function: ca.Function, source: Sequence[str], taken: Sequence[tuple[int, str]]) -> str:
    """Return the C text of a product with a large matrix, from values of the column; `taken` as in :func:`_row`."""
    matrix = matrix_of(function)
    assert matrix is not None
    column = ", ".join(source[-function.numel_in(function.n_in() - 1) :])
    call = f"{matrix[0]}{'_back' if matrix[1] else ''}(v0, v1);"
    results = " ".join(f"{value} = v1[{j}];" for j, value in taken)
    return f"{{ const double v0[] = {{{column}}}; double v1[{function.numel_out(0)}]; {call} {results} }}"


@dataclass(frozen=True)
class Language:
    """Text of the operations of a trace in a language."""

    expressions: Mapping[int, str]
    """Operation to the pattern of its operands."""
    number: Callable[[float], str]
    argument: Callable[[str, int], str]
    """Text of an element of an argument, counted from 0."""
    result: Callable[[str, int], str]
    """Text of an element of a result."""
    row: Callable[[ca.Function, str, Sequence[tuple[int, str]]], str] = _row
    """Text of the lookup of a row; see :func:`_row`."""
    product: Callable[[ca.Function, Sequence[str], Sequence[tuple[int, str]]], str] | None = None
    """Text of a product with a large matrix, see :func:`_product`; None if there is none."""
    assignment: str = "{} = {};"


C = Language(EXPRESSIONS, c_constant, "{}[{}]".format, "{}_out[{}]".format, product=_product)


def operations_of(function: ca.Function, language: Language = C) -> list[Operation]:
    """Return the operations of a trace, a line each; calls in a function of vectors are written out."""
    if not function.is_a("SXFunction"):
        function = function.expand(function.name())
    arguments, results = function.name_in(), function.name_out()
    lines: list[Operation] = []
    assign, named = language.assignment.format, "${}$".format
    operands = {code: [int(k) for k in _OPERAND.findall(text)] for code, text in language.expressions.items()}
    held: dict[int, int] = {}
    count = 0
    for k, operation, inputs, places in instructions(function):
        reads = () if operation == ca.OP_INPUT else tuple([held[place] for place in inputs])
        values, names = [*map(named, reads)], ()
        if operation == ca.OP_OUTPUT:
            lines.append(Operation(assign(language.result(results[places[0]], places[1]), values[0]), reads))
            continue
        made = {j: count + j for j, place in enumerate(places) if place >= 0}
        count += len(places)
        held |= {places[j]: i for j, i in made.items()}
        wanted = [(j, named(i)) for j, i in made.items()]
        target = wanted[0][1]
        if operation == ca.OP_CONST:
            text = assign(target, language.number(function.instruction_constant(k)))
        elif operation == ca.OP_CALL:
            called = function.instructions_sx()[k].which_function()
            if called.name().startswith(LOOKUP):
                text = language.row(called, values[0], wanted)
            elif MATRIX not in called.name():  # the derivative of a lookup
                text, reads = " ".join(assign(name, language.number(0.0)) for _, name in wanted), ()
            elif language.product is not None and matrix_of(called) is not None:
                text = language.product(called, values, wanted)
            else:
                raise KernelError(
                    f"{function.name()}: no code can be generated for a product with a large matrix here."
                )
        elif operation == ca.OP_INPUT:
            names = (arguments[inputs[0]],)
            text = assign(target, language.argument(names[0], inputs[1]))
        elif operation in operands:
            text = assign(target, language.expressions[operation].format(*values))
            reads = tuple([reads[j] for j in operands[operation]])
        else:
            name = next(key for key, code in vars(ca).items() if key.startswith("OP_") and code == operation)
            raise KernelError(
                f"{function.name()}: CasADi's operation {name} cannot be written in C. Use others, or write "
                'backend = "python" in the class of the unit.'
            )
        lines.append(Operation(text, reads, tuple(made.values()), names))
    return lines


_OPERAND = re.compile(r"\{(\d)\}")


def _lookup(function: ca.Function) -> str:
    """Return the C text of a table and its reader ``static void name(const double *x, double *row)``, once per file."""
    edges, rows = lookup_table(function)
    name, w = function.name(), function.numel_out(0)
    return f"""{source_text("lookup.h")}
#ifndef {name.upper()}
#define {name.upper()}
static const scalar {name}_edges[] = {{
{_listed(edges)}
}};
static const scalar {name}_rows[] = {{
{_listed(rows)}
}};

static void {name}(const double *x, double *row)
{{
    (void)x;
    for (int i = 0; i < LOOKUP_LANES; i++) {{
        const scalar *from = {name}_rows + {w} * lookup_place({name}_edges, {len(edges) - 1}, LANE(*x, i));
        for (int j = 0; j < {w}; j++)
            LANE(row[j], i) = from[j];
    }}
}}
#endif

"""


_PRODUCT, _FACTORS = "void", "const double *restrict x, double *restrict y"


def _matrix(name: str, numbers: npt.NDArray[np.float64]) -> str:
    """Return the C text of a matrix, column by column, and of both products with it.

    Sums have CasADi's order, so results are bit-identical. Single-precision numbers take half the space.
    """
    m, n = numbers.shape
    single = np.array_equal(numbers, numbers.astype(np.float32))
    listed = [f"{value!s}f" for value in numbers.T.astype(np.float32).ravel()] if single else numbers.T.ravel().tolist()
    lines = ",\n".join("    " + ", ".join(map(str, listed[i : i + 8])) for i in range(0, len(listed), 8))
    return f"""#ifndef {name.upper()}
#define {name.upper()}
static const {"float" if single else "scalar"} {name}_columns[] = {{
{lines}
}};

{_PRODUCT} {name}({_FACTORS});
{_PRODUCT} {name}({_FACTORS})
{{
    for (int i = 0; i < {m}; i++)
        y[i] = (double){{0}};
    for (int j = 0; j < {n}; j++)
        for (int i = 0; i < {m}; i++)
            y[i] += (scalar){name}_columns[{m} * j + i] * x[j];
}}

{_PRODUCT} {name}_back({_FACTORS});
{_PRODUCT} {name}_back({_FACTORS})
{{
    for (int j = 0; j < {n}; j++) {{
        y[j] = (double){{0}};
        for (int i = 0; i < {m}; i++)
            y[j] += (scalar){name}_columns[{m} * j + i] * x[i];
    }}
}}
#endif
"""


def _listed(numbers: Iterable[float]) -> str:
    texts = list(map(repr, numbers))
    return ",\n".join("    " + ", ".join(texts[i : i + 5]) for i in range(0, len(texts), 5))
