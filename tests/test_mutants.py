"""`make mutants` seeds faults that are Python, each in one place."""

import ast
from pathlib import Path

from tests.mutants import faults

SOURCE = "def f(a, b):\n    if a < 3 and b:\n        return a + b\n    return a if b is None else 2.5\n"


def test_a_fault_changes_one_place_of_a_file():
    made = list(faults(Path("f.py"), SOURCE))
    assert {(each.before, each.after) for each in made} == {
        ("a < 3 and b", "(a < 3 or b)"), ("a < 3", "(a >= 3)"), ("3", "(7)"), ("return a + b", "return None"),
        ("a + b", "(a - b)"), ("return a if b is None else 2.5", "return None"), ("2.5", "(6.0)"),
        ("a < 3 and b", "(not (a < 3 and b))"), ("b is None", "(not b is None)"), ("b is None", "(b is not None)"),
    }  # fmt: skip
    for each in made:
        lines = zip(SOURCE.splitlines(), each.source.splitlines(), strict=True)
        assert sum(before != after for before, after in lines) == 1
        ast.parse(each.source)
