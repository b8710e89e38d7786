"""Author, licence, copyright and version of a unit of a user's own, in its FMU; those of vdfmu are of its own units."""

import zipfile
from xml.etree import ElementTree

import pytest

import vdfmu
from tests.compiler.fmu.gain import UNIT
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError

PROJECT = """
[project]
name = "mine"
version = "3.1"
license = "BSD-3-Clause"
authors = [{ name = "Ada" }, { email = "bob@example.org" }]
"""
OF_PROJECT = {"version": "3.1", "author": "Ada, bob@example.org", "license": "BSD-3-Clause"}
FORMS = (("native", "2.0"), ("native", "3.0"), ("python", "2.0"))


def built(folder, backend="native", version="2.0"):
    (path,) = build_fmus(
        None, folder / "fmus", units=[folder / "gain.py"], backend=backend, fmi_version=version
    ).values()
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        names = archive.namelist()
        texts = [
            archive.read(f"documentation/{name}").decode()
            for name in ("licenses/license.txt", "index.html")
            if f"documentation/{name}" in names
        ]
    wanted = ("version", "author", "copyright", "license")
    return {name: root.get(name) for name in wanted if root.get(name) is not None}, texts


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "gain.py").write_text(UNIT)
    (tmp_path / "deep" / "pyproject.toml").write_text("[tool.other]\n")  # a file of tools alone is of no project
    return tmp_path / "deep"


@pytest.mark.few(1)
@pytest.mark.parametrize(("backend", "version"), FORMS)
def test_a_unit_has_the_author_and_the_licence_of_its_project_or_none(folder, backend, version):
    assert built(folder, backend, version)[0] == {}
    (folder.parent / "pyproject.toml").write_text(PROJECT)
    about, texts = built(folder, backend, version)  # of the same unit: another FMU
    assert about == OF_PROJECT
    if backend == "native":
        licence, page = texts
        assert licence.startswith("The unit Gain (sources/unit.c and sources/kernel_*.c): Ada, bob@example.org, BSD-3")
        assert "MIT License" in licence  # of the C that all units have
        assert "BSD-3-Clause. The C files that all units have are of vdfmu, MIT." in page


def test_what_the_class_says_counts(folder):
    (folder.parent / "pyproject.toml").write_text(PROJECT)
    attributes = 'author, copyright = "Eve", "(c) 2026 Eve"; license = "proprietary"'
    (folder / "gain.py").write_text(UNIT.replace("# here", attributes))
    about, (licence, _) = built(folder)
    assert about == {**OF_PROJECT, "author": "Eve", "copyright": "(c) 2026 Eve", "license": "proprietary"}
    assert "(c) 2026 Eve, proprietary." in licence
    (folder / "gain.py").write_text(UNIT.replace("# here", "author = 3"))
    with pytest.raises(UnitError, match=r"gain\.py, line 6: Gain: author: expected a text, got 3"):
        built(folder)


def test_units_of_the_package_have_its_own(tmp_path):
    (path,) = build_fmus(vdfmu.load_robot("planar_2dof"), tmp_path, units=["controller"], folded=True).values()
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert [root.get(name) for name in ("version", "author", "license")] == [
        vdfmu.__version__, "vdfmu contributors", "MIT",
    ]  # fmt: skip
