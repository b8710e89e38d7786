"""Every equation of the paper is cited by the docstring of the function or class that holds it."""

import ast
import re

import pytest

from vdfmu.data import PACKAGE


def cited() -> set[int]:
    """Return the numbers that docstrings of functions and classes in vdfmu/equations cite, ranges expanded."""
    numbers: set[int] = set()
    for path in (PACKAGE / "equations").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                text = ast.get_docstring(node) or ""
                for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", text):
                    numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


@pytest.mark.parametrize("number", range(1, 64))
def test_the_equation_has_a_function(number):
    assert number in cited()
