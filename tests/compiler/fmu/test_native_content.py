"""What a native FMU holds: libraries, sources, pages, reference results that the unit makes again."""

from __future__ import annotations

import json
import os
import struct
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv
from fmpy.validation import validate_fmu
from lxml import etree, html

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.c import PLATFORMS, platforms
from vdfmu.compiler.c.platforms import ALL
from vdfmu.compiler.fmu.native import fmi_headers
from vdfmu.compiler.unit.interface import Interface

VERSIONS = ("2.0", "3.0")
pytestmark = pytest.mark.heavy  # FMUs for all platforms


class Lazy(dict[str, dict[str, Path]]):
    """FMUs by version and unit, built when they are first asked for."""

    def __init__(self, robot: Robot, folder: Path) -> None:
        super().__init__()
        self.robot, self.folder = robot, folder

    def __missing__(self, version: str) -> dict[str, Path]:
        self[version] = build_fmus(
            self.robot, self.folder / version, backend="native", fmi_version=version, platforms="all"
        )
        return self[version]


@pytest.fixture(scope="module")
def native(planar: Robot, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Mapping[str, Path]]:
    """Native FMUs of the planar robot for all platforms."""
    return Lazy(planar, tmp_path_factory.mktemp("native"))


@pytest.fixture(params=VERSIONS)
def version(request: pytest.FixtureRequest) -> str:
    """Version of FMI."""
    return request.param


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def test_an_fmu_holds_what_the_standard_has_a_place_for(
    native: Mapping[str, Mapping[str, Path]], version: str, unit_name: str
) -> None:
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
    assert validate_fmu(str(path)) == []
    assert path.stat().st_size < 3e6


def test_a_library_exports_the_functions_of_fmi_and_nothing_else(
    native: Mapping[str, Mapping[str, Path]], version: str
) -> None:
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


def elf_exports(data: bytes) -> set[str]:
    """Names of defined dynamic symbols of a 64-bit library."""
    (table,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + i * size) for i in range(count)]
    (dynamic,) = [s for s in sections if s[1] == 11]
    names = sections[dynamic[6]]
    found: set[str] = set()
    for at in range(dynamic[4], dynamic[4] + dynamic[5], 24):
        name, _, _, section = struct.unpack_from("<IBBH", data, at)
        if section:
            found.add(text_at(data, names[4] + name))
    return found


def pe_exports(data: bytes) -> set[str]:
    """Names that a 64-bit DLL exports."""
    (header,) = struct.unpack_from("<I", data, 0x3C)
    count, _, _, _, optional = struct.unpack_from("<HIIIH", data, header + 6)
    (exports,) = struct.unpack_from("<I", data, header + 24 + 112)
    sections = [struct.unpack_from("<8sIIII", data, header + 24 + optional + 40 * i) for i in range(count)]

    def offset(address: int) -> int:
        for _, size, start, _, where in sections:
            if start <= address < start + size:
                return address - start + where
        raise AssertionError(address)

    number, _, names = struct.unpack_from("<III", data, offset(exports) + 24)
    table = struct.unpack_from(f"<{number}I", data, offset(names))
    return {text_at(data, offset(address)) for address in table}


def text_at(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()


def test_the_libraries_of_macos_know_their_name_and_one_file_serves_both_processors(
    native: Mapping[str, Mapping[str, Path]],
) -> None:
    """Importers of FMI 2.0 look into darwin64 on either. Each part begins on a page, as macOS demands."""
    two, three = (members(native[v]["trajectory"]) for v in VERSIONS)
    both = two["binaries/darwin64/Trajectory.dylib"]
    magic, count = struct.unpack_from(">II", both)
    assert (magic, count) == (0xCAFEBABE, 2)
    for i, cpu in enumerate((0x01000007, 0x0100000C)):
        found, _, offset, size, align = struct.unpack_from(">IIIII", both, 8 + 20 * i)
        part = both[offset : offset + size]
        assert (found, offset % 2**align, align) == (cpu, 0, 14)
        assert struct.unpack_from("<II", part) == (0xFEEDFACF, cpu)
        assert b"@rpath/Trajectory.dylib" in part
    assert both.endswith(two["binaries/aarch64-darwin/Trajectory.dylib"])
    assert b"@rpath/Trajectory.dylib" in three["binaries/x86_64-darwin/Trajectory.dylib"]


@pytest.mark.parametrize(
    ("chosen", "folders"),
    [
        (["aarch64-linux"], {"aarch64-linux", "linux64"}),
        (["x86_64-linux", "aarch64-linux"], {"aarch64-linux", "linux64"}),
        (["aarch64-darwin"], {"aarch64-darwin", "darwin64"}),
        (["x86_64-darwin"], {"darwin64"}),
        (["x86_64-windows"], {"win64"}),
    ],
)
def test_importers_of_fmi_2_find_a_library_in_the_folder_of_their_system(chosen: list[str], folders: set[str]) -> None:
    files = platforms.binaries("Plant", {name: name.encode() for name in chosen}, "2.0")
    assert {path.split("/")[1] for path in files} == folders
    if "x86_64-linux" in chosen:
        assert files["binaries/linux64/Plant.so"] == b"x86_64-linux"


def test_the_page_shows_equations_and_every_variable_and_needs_nothing_else(
    native: Mapping[str, Mapping[str, Path]], version: str, unit_name: str, planar: Robot
) -> None:
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


def test_the_files_about_the_content_tell_what_was_built(
    native: Mapping[str, Mapping[str, Path]], planar: Robot, version: str
) -> None:
    path = native[version]["plant"]
    data = json.loads(members(path)["extra/vdfmu/vdfmu.json"])
    assert data["platforms"] == list(ALL)
    assert data["backend"] == "native"
    assert data["robot"] == planar.to_dict()
    assert data["tool"].startswith("ziglang 0.")
    assert "MIT License" in members(path)["documentation/licenses/license.txt"].decode()


# ------------------------------------------------------------------ reference results

REFERENCE = "extra/org.fmi-standard.fmi-ls-ref/"


def test_the_manifest_is_that_of_the_layered_standard(
    native: Mapping[str, Mapping[str, Path]], version: str, unit_name: str
) -> None:
    """Root attributes by the schema that FMI 3.0 has for all layered standards; files that exist."""
    inside = members(native[version][unit_name])
    manifest = inside[f"{REFERENCE}fmi-ls-manifest.xml"]
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3LayeredStandardManifest.xsd"
    root = etree.fromstring(manifest)
    common = etree.Element("fmiLayeredStandardManifest", dict(root.attrib), nsmap=root.nsmap)
    space = etree.parse(schema).getroot().get("targetNamespace")
    common.tag = f"{{{space}}}fmiLayeredStandardManifest"
    etree.XMLSchema(etree.parse(schema)).assertValid(common)
    assert root.tag == "fmiReferences"
    for related in ElementTree.fromstring(manifest):
        source = os.path.normpath(REFERENCE + related.get("source", ""))
        assert source.replace(os.sep, "/") in inside
    results = [r.get("source") for r in root if r.get("role") == "result"]
    assert results == [f"{native[version][unit_name].stem}_out.csv"]


# The table has 12 digits: 5e-12. Rounding is less. The plant: its solver runs at 1e-9, and what amplifies a local error
# over 0.2 s is below 1e3.
BOUND = {"trajectory": 1e-11, "feedforward": 1e-11, "controller": 1e-11, "estimator": 1e-11, "plant": 1e-6}


@pytest.mark.parametrize("robot", ["planar_2dof", "slider_3dof"])
def test_the_unit_makes_the_reference_results(
    robots: Mapping[str, Robot], robot: str, unit_name: str, tmp_path: Path
) -> None:
    path = build_fmus(robots[robot], tmp_path, units=[unit_name], backend="native")[unit_name]
    folder = Path(fmpy.extract(path, tmp_path / "unpacked")) / REFERENCE
    expected = read_csv(folder / f"{path.stem}_out.csv")
    inputs = folder / f"{path.stem}_in.csv"
    names = expected.dtype.names[1:]
    has_states = unit_name == "plant"
    for kind in ("CoSimulation", "ModelExchange")[: 1 + has_states]:
        result = fmpy.simulate_fmu(
            str(path), fmi_type=kind, stop_time=expected["time"][-1], output_interval=expected["time"][1],
            relative_tolerance=1e-9, input=read_csv(inputs) if inputs.exists() else None, output=names,
        )  # fmt: skip
        # model exchange has a row before each change of the inputs and one after it
        rows = [int(np.flatnonzero(np.isclose(result["time"], t))[0]) for t in expected["time"]]
        # CVODE too bounds the local error of a step, in a norm of its own
        factor = 100.0 if kind == "ModelExchange" else 1.0
        for name in names:
            error = np.abs(result[name][rows] - expected[name]) / (1.0 + np.abs(expected[name]))
            assert error.max() < factor * BOUND[unit_name], name


def test_reference_results_end_where_an_arm_runs_away(planar: Robot, tmp_path: Path) -> None:
    """Torques that no spring could hold: the results stop, the build goes on."""
    start = {"plant": {"equilibrium": False, "tau_s_0[1]": 1e300, "kappa_dot_0[1]": 1e300}}
    path = build_fmus(planar, tmp_path, units=["plant"], start_values=start, backend="native")["plant"]
    rows = members(path)[f"{REFERENCE}Plant_out.csv"].decode().splitlines()
    assert len(rows) < 22
    assert not {"nan", "inf"} & set(",".join(rows[1:]).split(","))


def test_fmpy_compiles_the_sources(native: Mapping[str, Mapping[str, Path]], version: str, tmp_path: Path) -> None:
    """With the system's compiler and cmake; the unit computes the same to rounding."""
    from fmpy.build import build_platform_binary

    path = native[version]["controller"]
    folder = Path(fmpy.extract(path, tmp_path / "unpacked"))
    for library in (folder / "binaries").rglob("*.so"):
        library.unlink()
    environment = os.environ["PATH"]
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment}"
    try:
        build_platform_binary(folder)
    finally:
        os.environ["PATH"] = environment
    options = {"stop_time": 0.1, "output_interval": 0.01}
    ours, theirs = (fmpy.simulate_fmu(str(fmu), **options) for fmu in (path, folder))
    for name in ours.dtype.names:
        np.testing.assert_allclose(theirs[name], ours[name], rtol=1e-14, err_msg=name)
