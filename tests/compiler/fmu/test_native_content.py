"""What a native FMU holds: libraries, sources, pages, reference results that the unit makes again."""

import json
import os
import struct
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest
from lxml import etree, html

from tests.compiler.conftest import Lazy
from tests.compiler.exports import REFERENCE, elf_exports, pe_exports
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import shipped_units
from vdfmu.base import platforms
from vdfmu.base.platforms import ALL, PLATFORMS
from vdfmu.compiler.fmu.native import fmi_headers
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.inspect.fmu import related_notes

VERSIONS = ("2.0", "3.0")
pytestmark = pytest.mark.heavy  # FMUs for all platforms


@pytest.fixture(scope="module")
def native(planar, tmp_path_factory):
    out = tmp_path_factory.mktemp("native")
    return Lazy(lambda v: build_fmus(planar, out / v, backend="native", fmi_version=v, platforms="all", folded=True))


@pytest.fixture(params=VERSIONS)
def version(request):
    return request.param


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def test_an_fmu_holds_what_the_standard_has_a_place_for(native, version, unit_name):
    path = native[version][unit_name]
    inside, name = members(path), path.stem
    folders = ("linux64", "aarch64-linux", "win64", "darwin64", "aarch64-darwin")
    expected = {
        f"binaries/{folder}/{name}{PLATFORMS[platform].suffix}"
        for folder, platform in zip(folders if version == "2.0" else ALL, ALL, strict=True)
    }
    assert {n for n in inside if n.startswith("binaries/")} == expected
    assert not [n for n in inside if n.startswith("resources/")]
    assert {"documentation/index.html", "documentation/licenses/license.txt"} <= inside.keys()
    assert {"terminalsAndIcons/terminalsAndIcons.xml", "terminalsAndIcons/icon.png"} <= inside.keys()
    assert ("sources/buildDescription.xml" in inside) == (version == "3.0")
    assert ("model.png" in inside) == (version == "2.0")
    # the importer has the headers of FMI
    assert not [n for n in inside if n.startswith("sources/fmi") and n.endswith(".h")]
    description = fmpy.read_model_description(path)
    (files,) = description.buildConfigurations[0].sourceFileSets
    assert set(files.sourceFiles) == {n[8:] for n in inside if n.startswith("sources/") and n.endswith(".c")}
    assert path.stat().st_size < 3e6


def test_a_library_exports_the_functions_of_fmi_and_nothing_else(native, version):
    """Every function of the header. Names of Windows and Linux are read from their tables of symbols."""
    inside = members(native[version]["plant"])
    major = version[0]
    prototypes = fmi_headers(version)[f"fmi{major}Functions.h"].decode()
    wanted = {
        line.split()[1] for line in prototypes.splitlines() if line.startswith("#define fmi") and "FullName(fmi" in line
    }
    assert len(wanted) > 40
    for folder, suffix, read in (
        ("linux64" if version == "2.0" else "x86_64-linux", ".so", elf_exports),
        ("aarch64-linux", ".so", elf_exports),
        ("win64" if version == "2.0" else "x86_64-windows", ".dll", pe_exports),
    ):
        assert read(inside[f"binaries/{folder}/Plant{suffix}"]) == wanted, folder


def test_the_libraries_of_macos_know_their_name_and_one_file_serves_both_processors(native):
    """Importers of FMI 2.0 look into darwin64 on either. Each part begins on a page, as macOS demands."""
    two, three = (members(native[v]["trajectory"]) for v in VERSIONS)
    both = two["binaries/darwin64/Trajectory.dylib"]
    magic, count = struct.unpack_from(">II", both)
    assert (magic, count) == (0xCAFEBABE, 2)
    for i, cpu in enumerate((0x01000007, 0x0100000C)):
        cpu_type, _, offset, size, align = struct.unpack_from(">IIIII", both, 8 + 20 * i)
        part = both[offset : offset + size]
        assert (cpu_type, offset % 2**align, align) == (cpu, 0, 14)
        assert struct.unpack_from("<II", part) == (0xFEEDFACF, cpu)
        assert b"@rpath/Trajectory.dylib" in part
    assert both.endswith(two["binaries/aarch64-darwin/Trajectory.dylib"])
    assert b"@rpath/Trajectory.dylib" in three["binaries/x86_64-darwin/Trajectory.dylib"]


@pytest.mark.parametrize(("chosen", "folders"), [
    (["aarch64-linux"], {"aarch64-linux", "linux64"}),
    (["x86_64-linux", "aarch64-linux"], {"aarch64-linux", "linux64"}),
    (["aarch64-darwin"], {"aarch64-darwin", "darwin64"}),
    (["x86_64-darwin"], {"darwin64"}),
    (["x86_64-windows"], {"win64"}),
])  # fmt: skip
def test_importers_of_fmi_2_find_a_library_in_the_folder_of_their_system(chosen, folders):
    files = platforms.binaries("Plant", {name: name.encode() for name in chosen}, "2.0")
    assert {path.split("/")[1] for path in files} == folders
    if "x86_64-linux" in chosen:
        assert files["binaries/linux64/Plant.so"] == b"x86_64-linux"


def test_the_page_shows_equations_and_every_variable_and_the_files_about_it_what_was_built(
    native, version, unit_name, planar
):
    page = html.fromstring(members(native[version][unit_name])["documentation/index.html"].decode())
    text = page.text_content()
    assert "Robot: planar_2dof." in text
    assert not page.xpath("//script | //link | //img")
    assert all(not a.get("href").startswith("http") for a in page.iter("a"))
    names = [cell.text_content() for cell in page.xpath("//td[@class='name']")]
    arrays = Interface(shipped_units()[unit_name], planar).arrays
    assert len(names) == len(arrays) - (version == "2.0")
    if unit_name == "plant":
        assert "no event indicators" in text
        assert "q[1] .. q[2]" in names or "q  (2)" in names
    path = native[version]["plant"]
    data = json.loads(members(path)["extra/vdfmu/vdfmu.json"])
    assert data["platforms"] == list(ALL)
    assert data["backend"] == "native"
    assert data["robot"] == planar.to_dict()
    assert data["tool"].startswith("ziglang 0.")
    assert "MIT License" in members(path)["documentation/licenses/license.txt"].decode()


def test_the_manifest_is_that_of_the_layered_standard(native, version, unit_name):
    """Root attributes by the schema that FMI 3.0 has for all layered standards; files that exist."""
    inside = members(native[version][unit_name])
    manifest = inside[f"{REFERENCE}fmi-ls-manifest.xml"]
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3LayeredStandardManifest.xsd"
    root = etree.fromstring(manifest)
    common = etree.Element("fmiLayeredStandardManifest", dict(root.attrib), nsmap=root.nsmap)
    space = etree.parse(schema).getroot().get("targetNamespace")
    common.tag = f"{{{space}}}fmiLayeredStandardManifest"
    etree.XMLSchema(etree.parse(schema)).assertValid(common)
    assert related_notes(root) == []
    for related in ElementTree.fromstring(manifest):
        source = os.path.normpath(REFERENCE + related.get("source", ""))
        assert source.replace(os.sep, "/") in inside
    results = [r.get("source") for r in root if r.get("role") == "result"]
    assert results == [f"{native[version][unit_name].stem}_out.csv"]


def test_reference_results_end_where_an_arm_runs_away(planar, tmp_path):
    """Torques that no spring could hold: the results stop, the build goes on."""
    start = {"plant": {"equilibrium": False, "tau_s_0[1]": 1e300, "kappa_dot_0[1]": 1e300}}
    path = build_fmus(planar, tmp_path, units=["plant"], parameters=start, backend="native", folded=True)["plant"]
    rows = members(path)[f"{REFERENCE}Plant_out.csv"].decode().splitlines()
    assert len(rows) < 22
    assert not {"nan", "inf"} & set(",".join(rows[1:]).split(","))
