"""Seed faults and see whether ``make test`` finds them: ``python -m tests.mutants [COUNT [SEED [WORD]]]``.

A fault is a changed operator or number, a negated condition or a dropped return value. COUNT of them (default 60) are
chosen at random, by SEED, from all files whose path has WORD. Each is seeded into a copy of the tree, where first the
tests of its room run, then all others, until one fails. Faults that no test finds are printed as missed: some of them
change no result.
"""

import ast
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
_PATIENCE = 1200
"""Seconds after which the tests are taken to hang, which finds a fault too."""
_NEEDED = ("vdfmu", "tests", "models", "ssp", "fmu_src", "examples", "benchmarks", "docs", "requirements")
_OTHER: dict[type[ast.AST], Any] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip


class Fault(NamedTuple):
    """A part of a file that becomes another."""

    file: Path
    line: int
    before: str
    after: str
    source: str
    """The whole file with the fault."""


def faults(file: Path, source: str) -> Iterator[Fault]:
    """Yield the faults of a file, in expressions and statements of one line."""
    lines = source.encode().splitlines(keepends=True)
    nodes = list(ast.walk(ast.parse(source)))
    texts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    pairs: list[tuple[Any, str | None]] = [(node, _changed(node)) for node in nodes if id(node) not in texts]
    conditions = (node.test for node in nodes if isinstance(node, ast.If | ast.While | ast.IfExp))
    pairs += [(test, ast.unparse(ast.UnaryOp(ast.Not(), test))) for test in conditions if id(test) not in texts]
    for node, changed in pairs:
        if changed is None or node.lineno != node.end_lineno:
            continue
        k, begin, end = node.lineno - 1, node.col_offset, node.end_col_offset
        before, after = lines[k][begin:end].decode(), f"({changed})" if isinstance(node, ast.expr) else changed
        line = lines[k][:begin] + after.encode() + lines[k][end:]
        yield Fault(file, k + 1, before, after, b"".join([*lines[:k], line, *lines[k + 1 :]]).decode())


def _changed(node: Any) -> str | None:
    """Return the text of a node with a fault; None if none is made of it. A text's parts have no places in 3.11."""
    match node:
        case ast.BinOp(left, operator, right) if type(operator) in _OTHER:
            return ast.unparse(ast.BinOp(left, _OTHER[type(operator)](), right))
        case ast.BoolOp(operator, values):
            return ast.unparse(ast.BoolOp(_OTHER[type(operator)](), values))
        case ast.Compare(left, [operator], right):
            return ast.unparse(ast.Compare(left, [_OTHER[type(operator)]()], right))
        case ast.Constant(int() | float() as number) if not isinstance(number, bool):
            return repr(2 * number + 1)
        case ast.Return(ast.expr()):
            return "return None"
        case _:
            return None


def first_failure(fault: Fault) -> str:
    """Return the first test that fails with a fault; empty if none does."""
    with tempfile.TemporaryDirectory(prefix="vdfmu_mutant_") as place:
        tree = Path(place)
        for name in _NEEDED:
            shutil.copytree(ROOT / name, tree / name)
        for path in ROOT.iterdir():
            if path.is_file():
                shutil.copy(path, tree)
        file = fault.file.relative_to(ROOT)
        (tree / file).write_text(fault.source, encoding="utf-8")
        room = f"tests/{file.parts[1]}"
        for chosen in ([room], ["tests", f"--ignore={room}"]):
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "-m", "not heavy", *chosen]
            environment = os.environ | {"PYTHONPATH": place}
            run = subprocess.Popen(
                command, cwd=tree, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
            try:
                shown, _ = run.communicate(timeout=_PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, signal.SIGKILL)
                run.communicate()
                return f"no end within {_PATIENCE} s"
            if run.returncode:
                match = _FAILED.search(shown)
                return match[1] if match else f"exit code {run.returncode}"
    return ""


def main(count: str = "60", seed: str = "1", word: str = "") -> int:
    """Try faults, and print what finds each; return whether one is missed."""
    files = sorted(file for file in (ROOT / "vdfmu").glob("*/**/*.py") if word in str(file.relative_to(ROOT)))
    listed = [fault for file in files for fault in faults(file, file.read_text(encoding="utf-8"))]
    missed = 0
    for fault in random.Random(int(seed)).sample(listed, min(int(count), len(listed))):
        began = time.monotonic()
        test = first_failure(fault)
        missed += not test
        where = f"{fault.file.relative_to(ROOT)}:{fault.line}"
        print(f"{time.monotonic() - began:5.0f} s  {where}: {fault.before[:60]}  ->  {fault.after[:60]}")
        print(f"         {test or 'MISSED'}", flush=True)
    print(f"{missed} missed")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
