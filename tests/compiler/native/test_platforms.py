"""The libraries of other platforms: run where an emulator is installed, and of the right form everywhere."""

import sys
from pathlib import Path

import fmpy
import pytest

from tests.compiler.conftest import alone
from tests.compiler.exports import macho_exports, macho_parts
from tests.compiler.native.binding import Model
from tests.compiler.native.conftest import HERE, bits, driver_arguments, program, run, version_flags
from tests.compiler.native.fmi_types import HEADERS, signatures
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.platforms import PLATFORMS

pytestmark = pytest.mark.heavy

UNITS = [("plant", "2.0"), ("feedforward", "2.0"), ("plant", "3.0")]


@pytest.fixture(scope="module")
def everywhere(planar, tmp_path_factory, kernel_cache):
    folders: dict[str, dict[str, Path]] = {}

    def build(version: str) -> dict[str, Path]:
        if version not in folders:
            out = tmp_path_factory.mktemp(f"all_{version[0]}")
            units = [unit for unit, v in UNITS if v == version]
            with alone(kernel_cache):
                fmus = build_fmus(
                    planar, out, units=units, backend="native", fmi_version=version, platforms="all", folded=True
                )
            folders[version] = {unit: Path(fmpy.extract(fmu, out / unit)) for unit, fmu in fmus.items()}
        return folders[version]

    return build


def library(folder: Path, version: str, platform: str) -> Path:
    p = PLATFORMS[platform]
    place = folder / "binaries" / (p.folder_2 if version == "2.0" else p.name)
    (path,) = place.glob(f"*{p.suffix}")
    return path


@pytest.fixture(scope="module")
def cross_driver(tmp_path_factory):
    drivers: dict[tuple[str, str], Path] = {}

    def make(platform: str, version: str) -> Path:
        if (platform, version) not in drivers:
            windows = platform.endswith("windows")
            path = tmp_path_factory.mktemp("cross") / ("driver.exe" if windows else "driver")
            libraries = [] if windows else ["-ldl", "-lm"]
            # -O3 -s as the units have it: with other flags the compiler makes its support for Windows again
            run([sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[platform].target, "-std=c11", "-O3", "-s",
                 f"-I{HEADERS}", *version_flags(version), HERE / "driver.c", "-o", path, *libraries],
                seconds=900)  # fmt: skip
            drivers[platform, version] = path
        return drivers[platform, version]

    return make


@pytest.mark.parametrize(("unit", "version"), UNITS)
def test_the_library_for_linux_on_arm_computes_the_same(everywhere, cross_driver, driver, unit, version):
    emulator = program("qemu-aarch64", "qemu-user", "qemu-aarch64-static")
    root = Path("/usr/aarch64-linux-gnu")
    if not root.is_dir():
        pytest.skip("needs the C library of Arm: apt install libc6-arm64-cross")
    folder = everywhere(version)[unit]
    model = Model(folder)
    arguments = driver_arguments(model)
    command = [emulator, "-L", root, cross_driver("aarch64-linux", version), library(folder, version, "aarch64-linux")]
    output = run([*command, *arguments], seconds=300)
    assert bits(output) == bits(run([driver(version), model.library._name, *arguments]))


@pytest.fixture(scope="module")
def wine(tmp_path_factory):
    path = program("wine64", "wine64", "/usr/lib/wine/wine64", "wine")
    environment = {"WINEPREFIX": str(tmp_path_factory.mktemp("wine")), "WINEDEBUG": "-all", "DISPLAY": ""}
    yield path, environment


@pytest.mark.parametrize(("unit", "version"), UNITS)
def test_the_library_for_windows_computes_the_same(everywhere, cross_driver, driver, wine, unit, version):
    folder = everywhere(version)[unit]
    model = Model(folder)
    arguments = driver_arguments(model)
    program_path, environment = wine
    windows = library(folder, version, "x86_64-windows")
    command = [program_path, cross_driver("x86_64-windows", version), "Z:" + str(windows).replace("/", "\\")]
    output = run([*command, *arguments], seconds=300, **environment)
    assert bits(output) == bits(run([driver(version), model.library._name, *arguments]))


_CPU = {"x86_64-darwin": 0x01000007, "aarch64-darwin": 0x0100000C}


@pytest.mark.parametrize(("unit", "version"), UNITS)
@pytest.mark.parametrize("platform", _CPU)
def test_the_libraries_for_macos_are_of_their_processor_and_export_fmi(everywhere, unit, version, platform):
    folder = everywhere(version)[unit]
    data = library(folder, version, platform).read_bytes()
    assert f"@rpath/{Path(library(folder, version, platform)).name}".encode() in data
    parts = macho_parts(data)
    if version == "3.0" or platform == "aarch64-darwin":
        assert set(parts) == {_CPU[platform]}
    names = macho_exports(parts[_CPU[platform]])
    names -= {"__mh_dylib_header", "___dso_handle"}  # the linker's own, of every library
    assert names == {f"_fmi{version[0]}{name}" for name in signatures(version)}
