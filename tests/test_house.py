"""Imports between the packages of vdfmu go down, and no file imports itself through others."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import vdfmu

ROOT = Path(vdfmu.__file__).parent
PACKAGES = ("base", "engine", "compiler", "arm", "system", "study", "cli", "extras")
"""From the bottom up. Engine and compiler do not know each other, and the core knows no extra."""
USES = {("learn", "batch"), ("identify", "matlab"), ("identify", "pictures"), ("linear", "pictures")}
"""Pairs of extras of which the first may import the second, see docs/extras.md."""
EQUATIONS = ("vdfmu.arm.equations", "vdfmu.arm.drive", "vdfmu.arm.world")


@cache
def _trees() -> dict[Path, ast.Module]:
    """Return the trees of the files of the package."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in ROOT.rglob("*.py")}


@cache
def _imports() -> dict[str, set[str]]:
    """Return each module with the modules that it imports, late ones and those for types too."""
    paths = {path.relative_to(ROOT.parent).with_suffix("").parts: path for path in ROOT.rglob("*.py")}
    modules = {".".join(p[:-1] if p[-1] == "__init__" else p): path for p, path in paths.items()}
    imports: dict[str, set[str]] = {}
    for name, path in modules.items():
        imports[name] = set()
        for node in ast.walk(_trees()[path]):
            if isinstance(node, ast.Import):
                imports[name] |= {alias.name for alias in node.names} & modules.keys()
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: a relative import"
                wholes = {f"{node.module}.{alias.name}" for alias in node.names}
                imports[name] |= {full if full in modules else str(node.module) for full in wholes} & modules.keys()
    return imports


def test_rooms_import_only_rooms_below():
    rank = {room: i for i, room in enumerate(PACKAGES)}
    assert {path.parent.name for path in ROOT.glob("*/__init__.py")} | {"extras"} == set(PACKAGES)
    for module, imported in _imports().items():
        room = module.split(".")[1] if "." in module else ""
        for target in imported if room in rank else ():  # else the names of users, at the top
            other = target.split(".")[1] if "." in target else ""
            assert rank.get(other, 99) <= rank[room], f"{module} imports {target}"
            assert {room, other} != {"engine", "compiler"}, f"{module} imports {target}"
            if room == other == "extras":
                pair = module.split(".")[2], target.split(".")[2]
                assert pair[0] == pair[1] or pair in USES, f"{module} imports {target}"


def test_a_room_imports_nothing_at_its_start_and_nothing_private_of_another():
    for room in PACKAGES[:-2]:
        tree = _trees()[ROOT / room / "__init__.py"]
        assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)], room
    for path, tree in _trees().items():
        room = f"vdfmu.{path.relative_to(ROOT).parts[0]}"
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and not f"{node.module}.".startswith(f"{room}."):
                names = [*str(node.module).split("."), *(alias.name for alias in node.names)]
                private = [name for name in names if name.startswith("_") and not name.endswith("__")]
                assert not private or not str(node.module).startswith("vdfmu"), f"{path}, line {node.lineno}"


def test_no_file_imports_itself_through_others():
    try:
        TopologicalSorter(_imports()).prepare()
    except CycleError as error:
        raise AssertionError(" <- ".join(error.args[1])) from None


def test_a_variable_says_what_it_holds():
    """Rule 7 of the plain words, for variables, parameters, fields and functions."""
    empty = {"found", "one", "given", "known", "own", "told", "what", "that", "those", "others", "nothing"}
    suspect = re.compile(rf"\b({'|'.join(empty)})\b *([-+*/|&:]?=|[:,()]|in\b)")  # most files need not be parsed
    named = (ast.Name, ast.arg, ast.Attribute, ast.keyword, ast.FunctionDef, ast.ExceptHandler)
    for folder in ("vdfmu", "tests", "benchmarks", "examples", "docs"):
        for path in (ROOT.parent / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            for node in ast.walk(ast.parse(text)) if suspect.search(text) else ():
                if not isinstance(node, named) or isinstance(getattr(node, "ctx", None), ast.Load):
                    continue  # such as hypothesis' given
                name = getattr(node, "id", None) or getattr(node, "arg", None) or getattr(node, "attr", None)
                name = node.name if isinstance(node, ast.FunctionDef | ast.ExceptHandler) else name
                assert name not in empty, f"{path}:{node.lineno}: {name}: expected a name for its content"


def test_the_equations_know_numbers_and_nothing_else():
    for module, imported in _imports().items():
        if module.startswith(EQUATIONS):
            allowed = (*EQUATIONS, "vdfmu.compiler.scalar", "vdfmu.base.measure")  # scalars, and bounds of numbers
            assert all(target.startswith(allowed) for target in imported), module


def test_ci_runs_heavy_tests_that_exist():
    for line in (ROOT.parent / "tests" / "smoke.txt").read_text().splitlines():
        file, _, name = line.split()[0].partition("::")
        if file.startswith("tests/extras/") and not (ROOT / "extras").exists():
            continue
        assert f"def {name}(" in (ROOT.parent / file).read_text(encoding="utf-8"), line


def test_no_test_file_imports_from_another():
    """What two files of tests share is a fixture, or in a module of its own."""
    taken = re.compile(r"^ *from tests[\w.]*(\.test_\w+ import| import .*\btest_)", re.MULTILINE)
    for path in (ROOT.parent / "tests").rglob("*.py"):
        assert not (match := taken.search(path.read_text(encoding="utf-8"))), f"{path}: {match[0]}"
