"""Author, licence, copyright and version of a unit of a user's own, in its FMU; those of vdfmu are of its own units."""

import zipfile
from xml.etree import ElementTree

import pytest

import vdfmu
from tests.compiler.fmu.gain import UNIT
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError

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


@pytest.mark.few(1)
@pytest.mark.parametrize(("backend", "version"), FORMS)
def test_a_unit_has_the_author_and_the_licence_of_its_class_or_none(tmp_path, backend, version):
    (tmp_path / "gain.py").write_text(UNIT)
    assert built(tmp_path, backend, version)[0] == {}
    texts = 'author, copyright = "Ada, Bob", "(c) 2026 Ada"; version, license = "3.1", "BSD-3-Clause"'
    (tmp_path / "gain.py").write_text(UNIT.replace("# here", texts))
    about, texts = built(tmp_path, backend, version)
    assert about == {"version": "3.1", "author": "Ada, Bob", "copyright": "(c) 2026 Ada", "license": "BSD-3-Clause"}
    if backend == "native":
        licence, page = texts
        assert licence.startswith("The unit Gain (sources/unit.c and sources/kernel_*.c): (c) 2026 Ada, BSD-3-Clause")
        assert "MIT License" in licence  # of the C that all units have
        assert "BSD-3-Clause. The C files common to all units belong to vdfmu (MIT)." in page
    (tmp_path / "gain.py").write_text(UNIT.replace("# here", "author = 3"))
    with pytest.raises(UnitError, match=r"gain\.py, line 6: Gain: author: expected a text, got 3"):
        built(tmp_path)


def test_units_of_the_package_have_its_own(tmp_path):
    (path,) = build_fmus(vdfmu.load_robot("planar_2dof"), tmp_path, units=["controller"], folded=True).values()
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert [root.get(name) for name in ("version", "author", "license")] == [
        vdfmu.__version__, "vdfmu contributors", "MIT",
    ]  # fmt: skip
