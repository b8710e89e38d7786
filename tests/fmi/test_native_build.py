"""Native builds: the same bits everywhere, all that an FMU should hold, clear words where a build cannot be."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv
from fmpy.validation import validate_fmu
from lxml import etree, html

from vdfmu.errors import FmuError, UsageError
from vdfmu.fmu import build_fmus, interface
from vdfmu.fmu.content import Content
from vdfmu.fmu.layout import Layout
from vdfmu.fmu.native import PLATFORMS, compile, native_available, platforms, this_platform
from vdfmu.fmu.native.compile import Job, compile_library
from vdfmu.fmu.native.package import fmi_headers, unit_sources
from vdfmu.model import Robot

VERSIONS = ("2.0", "3.0")
SMALL = {"unit.c": b"double twice(double x) { return 2.0 * x; }\n"}
FAST = ["trajectory", "controller"]
"""Units that compile in a second."""

BUILD = """
import sys
from vdfmu.fmu import build_fmus
from vdfmu.model import load_robot
build_fmus(load_robot("planar_2dof"), sys.argv[1], units=["trajectory", "controller"], backend="native")
"""


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


@pytest.fixture
def cold(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Empty cache; what zig compiles for itself stays where it is."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(support_folder()))
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


def support_folder() -> str:
    return os.environ.get("ZIG_GLOBAL_CACHE_DIR") or str(Path(os.environ["VDFMU_CACHE_DIR"]) / "zig")


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


# ------------------------------------------------------------------ the same bits


def test_a_cold_build_in_another_process_and_folder_has_the_same_bytes(
    planar: Robot, tmp_path: Path, run_python: Callable[..., str]
) -> None:
    here = build_fmus(planar, tmp_path / "here", units=FAST, backend="native")
    folder = tmp_path / "a longer name of a folder"
    folder.mkdir()
    run_python(
        BUILD, "out", cwd=folder, PYTHONHASHSEED="7", TMPDIR=str(folder),
        VDFMU_CACHE_DIR=str(folder / "cache"), ZIG_GLOBAL_CACHE_DIR=support_folder(),
    )  # fmt: skip
    for path in here.values():
        assert (folder / "out" / path.name).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize("platform", PLATFORMS)
def test_a_library_depends_on_its_sources_alone(platform: str, cold: Path, tmp_path: Path) -> None:
    """Neither on folder nor time nor what is compiled beside it. Windows counts time in seconds."""
    first = compile_library(SMALL, platform, name="Small")
    begin = time.time()
    for file in (cold / "native").iterdir():
        file.unlink()
    while int(time.time()) == int(begin):
        time.sleep(0.05)
    others = {**SMALL, "other.c": b"double other(double x) { return x; }\n"}
    jobs = [Job("Other", others, platform), Job("Small", SMALL, platform)]
    assert compile.compile_libraries(jobs)[1] == first
    assert str(tmp_path).encode() not in first
    assert b"vdfmu_native_" not in first


def test_the_compiler_says_nothing_about_any_file(planar: Robot, version: str) -> None:
    """With warnings as errors, those of the platforms that differ most: 32-bit long, and a C library of its own."""
    for unit in FAST:
        content = Content(unit, planar, {}, "native", version)
        sources = unit_sources(content) | fmi_headers(version)
        for platform in (this_platform(), "x86_64-windows"):
            compile_library(sources, platform, name=unit, flags=("-Werror",))


def test_guids_tell_apart_what_differs_and_nothing_else(planar: Robot) -> None:
    first = Content("plant", planar, {}, "native")
    others = [
        Content("plant", planar, {}),
        Content("plant", planar, {}, "native", "3.0"),
        Content("plant", planar, {}, "native", tool="ziglang 0.0"),
        Content("plant", planar, {}, "native", digest="0"),
        Content("plant", planar, {"q_0[1]": 0.1}, "native"),
        Content("controller", planar, {}, "native"),
    ]
    assert len({c.guid for c in (first, *others)}) == 7
    assert Content("plant", planar, {}, "native").guid == first.guid


# ------------------------------------------------------------------ what an FMU holds


def test_an_fmu_holds_what_the_standard_has_a_place_for(
    native: Mapping[str, Mapping[str, Path]], version: str, unit_name: str
) -> None:
    path = native[version][unit_name]
    inside, name = members(path), path.stem
    folders = ("linux64", "aarch64-linux", "win64", "darwin64", "aarch64-darwin")
    listed = PLATFORMS.values()
    expected = {
        f"binaries/{folder}/{name}{p.suffix}"
        for folder, p in zip(folders if version == "2.0" else PLATFORMS, listed, strict=True)
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
        line.split()[1]
        for line in prototypes.splitlines()
        if line.startswith("#define fmi") and "FullName(fmi" in line
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
def test_importers_of_fmi_2_find_a_library_in_the_folder_of_their_system(
    chosen: list[str], folders: set[str]
) -> None:
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
    arrays = Layout(interface(unit_name, planar)).arrays
    assert len(names) == len(arrays) - (version == "2.0")
    if unit_name == "plant":
        assert "no event indicators" in text
        assert "q[1] .. q[2]" in names or "q  (2)" in names


def test_the_files_about_the_content_tell_what_was_built(
    native: Mapping[str, Mapping[str, Path]], planar: Robot, version: str
) -> None:
    path = native[version]["plant"]
    data = json.loads(members(path)["extra/vdfmu/vdfmu.json"])
    assert data["platforms"] == list(PLATFORMS)
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
BOUND = {"trajectory": 1e-11, "feedforward": 1e-11, "controller": 1e-11, "plant": 1e-6}


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


# ------------------------------------------------------------------ what is up to date


def test_an_fmu_that_is_up_to_date_is_left_alone(planar: Robot, tmp_path: Path) -> None:
    def build(platforms: list[str] | None = None) -> os.stat_result:
        built = build_fmus(planar, tmp_path, units=FAST, backend="native", platforms=platforms)
        return built["controller"].stat()

    first = build()
    assert build().st_ino == first.st_ino
    assert build([this_platform()]).st_ino == first.st_ino
    wider = build([this_platform(), "x86_64-windows"])
    assert wider.st_ino != first.st_ino
    assert build().st_ino == wider.st_ino  # it holds more than is asked for
    assert build(["x86_64-darwin"]).st_ino != wider.st_ino


def test_backends_and_versions_replace_each_other_and_damaged_files(planar: Robot, tmp_path: Path) -> None:
    def build(**options: str) -> bytes:
        return build_fmus(planar, tmp_path, units=["controller"], **options)["controller"].read_bytes()

    python, native, native_3 = build(), build(backend="native"), build(backend="native", fmi_version="3.0")
    assert len({python, native, native_3}) == 3
    assert build() == python
    path = tmp_path / "PDController.fmu"
    path.write_bytes(native[: len(native) // 2])
    assert build(backend="native") == native
    assert sorted(tmp_path.iterdir()) == [path]


def test_a_second_build_compiles_nothing(
    planar: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = build_fmus(planar, tmp_path / "1", units=FAST, backend="native")
    monkeypatch.setattr(compile, "_zig", lambda: "/nowhere/zig")
    second = build_fmus(planar, tmp_path / "2", units=FAST, backend="native")
    for unit, path in first.items():
        assert second[unit].read_bytes() == path.read_bytes()


def test_other_start_values_compile_the_tables_alone(
    planar: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The traced equations are the same for all values of parameters and for both versions of FMI."""
    build_fmus(planar, tmp_path, units=FAST, backend="native")
    compiled: list[str] = []
    run = compile._Workshop._object

    def record(self: object, job: Job, place: Path, name: str, key: str) -> None:
        compiled.append(name)
        run(self, job, place, name, key)  # type: ignore[arg-type]

    monkeypatch.setattr(compile._Workshop, "_object", record)
    values = {"controller": {"K_p[1]": 123.0 + os.getpid()}}
    build_fmus(planar, tmp_path, units=["controller"], start_values=values, backend="native")
    assert compiled == ["unit.c"]


@pytest.mark.parametrize("damage", [b"", b"not a library"])
def test_a_damaged_cache_is_made_anew(damage: bytes, cold: Path) -> None:
    first = compile_library(SMALL, this_platform(), name="Small")
    for file in (cold / "native").iterdir():
        file.write_bytes(damage)
    assert compile_library(SMALL, this_platform(), name="Small") == first


# ------------------------------------------------------------------ builds that cannot be


def test_a_missing_compiler_is_told_with_the_way_out(
    planar: Robot, tmp_path: Path, cold: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compile, "find_spec", lambda name: None)
    compile._zig.cache_clear()
    try:
        assert not native_available()
        with pytest.raises(FmuError, match=r"ziglang, which is not installed.*pip install vdfmu\[native\]"):
            build_fmus(planar, tmp_path / "out", units=["controller"], backend="native")
    finally:
        compile._zig.cache_clear()
    assert not (tmp_path / "out").exists()


def test_a_file_that_the_compiler_refuses_is_named(cold: Path) -> None:
    sources = SMALL | {"kernel_bad.c": b"int bad(void) { return missing; }\n"}
    words = r"(?s)Plant for aarch64-linux: kernel_bad.c cannot be compiled:.*undeclared identifier 'missing'"
    with pytest.raises(FmuError, match=words):
        compile_library(sources, "aarch64-linux", name="Plant")
    with pytest.raises(FmuError, match=r"(?s)Plant for aarch64-linux: Plant.so cannot be compiled:.*missing"):
        unresolved = b"int missing(void);\nint bad(void) { return missing(); }\n"
        compile_library({"unit.c": unresolved}, "aarch64-linux", name="Plant", flags=("-Wl,-z,defs",))


def test_unknown_names_are_refused_with_the_known_ones(planar: Robot, tmp_path: Path) -> None:
    def build(**options: object) -> None:
        build_fmus(planar, tmp_path, **options)  # type: ignore[arg-type]

    with pytest.raises(UsageError, match=r"no platform 'win64'. There are: x86_64-linux.*; and all\."):
        build(backend="native", platforms=["x86_64-linux", "win64"])
    with pytest.raises(UsageError, match="No platform is chosen"):
        build(backend="native", platforms=[])
    with pytest.raises(UsageError, match="no backend 'rust'. There are: python, native"):
        build(backend="rust")
    with pytest.raises(UsageError, match=r"no FMI '1.0' here. There are: 2.0, 3.0"):
        build(backend="native", fmi_version="1.0")
    with pytest.raises(UsageError, match=r"Python FMUs are of FMI 2.0, got 3.0"):
        build(fmi_version="3.0")
    with pytest.raises(UsageError, match="Platforms can be chosen for native FMUs only"):
        build(platforms="all")
    assert list(tmp_path.iterdir()) == []


def test_a_machine_without_native_fmus_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platforms.machine, "machine", lambda: "riscv64")
    with pytest.raises(FmuError, match=r"for this machine, riscv64-linux. There are: x86_64-linux"):
        platforms.chosen_platforms(None)
    assert not native_available()
    assert platforms.chosen_platforms("all") == tuple(PLATFORMS)


def test_folders_that_cannot_be_written_are_told(
    planar: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FmuError, match=r"file/PDController.fmu: cannot be written: .*Choose another folder"):
        build_fmus(planar, tmp_path / "file", units=["controller"], backend="native")
    # a cache that cannot be written costs time alone
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", support_folder_of_zig(tmp_path))
    assert compile_library(SMALL, this_platform(), name="Small")


def support_folder_of_zig(tmp_path: Path) -> str:
    return os.environ.get("ZIG_GLOBAL_CACHE_DIR") or str(tmp_path / "zig")


def test_a_full_disk_is_told(monkeypatch: pytest.MonkeyPatch, cold: Path) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FmuError, match=r"cannot be compiled: .*No space left.*TMPDIR and VDFMU_CACHE_DIR"):
        compile_library(SMALL, this_platform(), name="Small")


# ------------------------------------------------------------------ several at once


@pytest.mark.slow
def test_builds_at_the_same_time_do_not_meet(tmp_path: Path) -> None:
    environment = os.environ | {
        "VDFMU_CACHE_DIR": str(tmp_path / "cache"), "ZIG_GLOBAL_CACHE_DIR": support_folder(),
    }  # fmt: skip
    folders = [tmp_path / str(i) for i in range(3)]
    processes = [
        subprocess.Popen([sys.executable, "-c", BUILD, str(folder)], env=environment) for folder in folders
    ]
    assert [process.wait(300) for process in processes] == [0, 0, 0]
    for name in ("Trajectory.fmu", "PDController.fmu"):
        assert len({(folder / name).read_bytes() for folder in folders}) == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no interrupt for a process")
def test_an_interrupt_leaves_no_process_and_nothing_half_done(tmp_path: Path) -> None:
    build = BUILD.replace('units=["trajectory", "controller"], ', "")
    (tmp_path / "tmp").mkdir()
    environment = os.environ | {
        "VDFMU_CACHE_DIR": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "tmp"),
        "ZIG_GLOBAL_CACHE_DIR": support_folder(),
    }  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, "-c", build, str(tmp_path / "out")], env=environment, stderr=subprocess.PIPE
    )
    while not list((tmp_path / "tmp").glob("vdfmu_native_*/*/*.o*")):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode != 0
    assert b"KeyboardInterrupt" in said
    assert list((tmp_path / "tmp").iterdir()) == []
    assert not (tmp_path / "out").exists()
    assert not list((tmp_path / "cache").rglob("*.tmp"))


@pytest.mark.slow
def test_fmpy_compiles_the_sources(
    native: Mapping[str, Mapping[str, Path]], version: str, tmp_path: Path
) -> None:
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
