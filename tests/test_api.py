"""The names of the package are few, and documentation imports no others than those of the reference."""

import ast
import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import vdfmu

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ast.parse(Path(vdfmu.__file__).read_text(encoding="utf-8"))
MODULES = ("drive", "dynamics", "motion", "plugin", "unit")
IMPORT = re.compile(r"^ *(?:\")?from vdfmu\.([\w.]+) import (\w[\w, ]*)", re.MULTILINE)


def test_checkers_and_users_have_the_same_few_names():
    (checked,) = (node for node in PACKAGE.body if isinstance(node, ast.If))
    names = [alias.asname for node in checked.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert sorted(names) == sorted(vdfmu.__all__) == dir(vdfmu)
    assert len(names) <= 22
    assert all(getattr(vdfmu, name) for name in names)


def test_a_name_that_moved_says_where_it_is():
    with pytest.raises(AttributeError, match=r"^vdfmu.tune moved. Write: from vdfmu.extras.tune import tune$"):
        vdfmu.__getattr__("tune")
    with pytest.raises(AttributeError, match="^module 'vdfmu' has no attribute 'tone'$"):
        vdfmu.__getattr__("tone")
    for name, place in vdfmu._MOVED.items():
        if not place.startswith("extras.") or find_spec("vdfmu.extras"):
            assert hasattr(import_module(f"vdfmu.{place}"), name)


@pytest.mark.parametrize("extra", sorted(path.parent.name for path in ROOT.glob("vdfmu/extras/*/__init__.py")))
def test_the_names_of_an_extra_are_no_modules(extra):
    package = import_module(f"vdfmu.extras.{extra}")
    for name in getattr(package, "__all__", ()) * 2:  # the second time its module is imported
        assert not isinstance(getattr(package, name), ModuleType), name


def test_pages_import_names_that_the_reference_has():
    pages = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/notebooks/*.ipynb"), ROOT / "README.md"]
    overview = (ROOT / "docs/reference/api.md").read_text(encoding="utf-8")
    for page in pages:
        for place, names in IMPORT.findall(page.read_text(encoding="utf-8")):
            for name in names.split(", "):
                row = re.search(rf"`{name}`.*\| .*`vdfmu\.{place}`", overview)
                assert place in MODULES or row, f"{page.name}: {place}.{name}"
