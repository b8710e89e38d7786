"""Native builds: the same bits everywhere, nothing stale, clear words where a build cannot be."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import shipped_units
from vdfmu.base import compile, platforms
from vdfmu.base.compile import Compilation, compile_library
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.platforms import PLATFORMS, native_available, this_platform
from vdfmu.compiler.c.rolled import rolled
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.fmu.native import fmi_headers, unit_sources

SMALL = {"unit.c": b"double twice(double x) { return 2.0 * x; }\n"}
FAST = ["trajectory", "controller"]
"""Units that compile in a second."""

BUILD = """
import sys
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
build_fmus(load_robot("planar_2dof"), sys.argv[1], units=["trajectory", "controller"], backend="native", folded=True)
"""


@pytest.fixture
def cold(monkeypatch, tmp_path):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.mark.parametrize(
    "platform", [pytest.param(p, marks=[pytest.mark.heavy] * (p != this_platform())) for p in PLATFORMS]
)
def test_a_library_depends_on_its_sources_alone(platform, cold, tmp_path):
    """Neither on folder nor time nor what is compiled beside it. Windows counts time in seconds."""
    first = compile_library(SMALL, platform, name="Small")
    begin = time.time()
    for file in (cold / "native").iterdir():
        file.unlink()
    while int(time.time()) == int(begin):
        time.sleep(0.05)
    two_files = {**SMALL, "other.c": b"double other(double x) { return x; }\n"}
    jobs = [Compilation("Other", two_files, platform), Compilation("Small", SMALL, platform)]
    assert compile.compile_libraries(jobs)[1] == first
    assert str(tmp_path).encode() not in first
    assert b"vdfmu_native_" not in first


@pytest.mark.heavy
@pytest.mark.parametrize("platform", [name for name, each in PLATFORMS.items() if each.libraries])
def test_a_library_is_the_one_that_zigs_own_c_library_gives(platform, cold, monkeypatch):
    """Each function that is declared of the system's libraries: in the same file, of the same version."""
    libraries = PLATFORMS[platform].libraries
    names = [name for versions in libraries.values() for listed in versions.values() for name in listed.split()]
    declared = "".join(f'extern const char at_{name}[] __asm__("{name}");\n' for name in names)
    places = ", ".join(f"at_{name}" for name in names)
    source = f'{declared}__attribute__((visibility("default"))) const char *const all[] = {{{places}}};\n'
    sources = {"unit.c": source.encode()}
    library = compile_library(sources, platform, name="All")
    monkeypatch.setitem(PLATFORMS, platform, replace(PLATFORMS[platform], libraries={}))
    assert compile_library(sources, platform, name="All", flags=("-lm",)) == library
    assert all(name.encode() in library for name in (*names, *libraries))


@pytest.mark.heavy
def test_the_compiler_says_nothing_about_any_file(planar, version):
    """With warnings as errors, those of the platforms that differ most: 32-bit long, and a C library of its own."""
    for unit in FAST:
        content = Content(shipped_units()[unit], planar, {}, "native", version)
        sources = unit_sources(content) | fmi_headers(version)
        for platform in (this_platform(), "x86_64-windows"):
            compile_library(sources, platform, name=unit, flags=("-Werror",))


@pytest.mark.heavy
def test_an_fmu_that_is_up_to_date_is_left_alone(planar, tmp_path):
    def build(platforms: list[str] | None = None) -> os.stat_result:
        built = build_fmus(planar, tmp_path, units=FAST, backend="native", platforms=platforms, folded=True)
        return built["controller"].stat()

    first = build()
    assert build().st_ino == first.st_ino
    assert build([this_platform()]).st_ino == first.st_ino
    wider = build([this_platform(), "x86_64-windows"])
    assert wider.st_ino != first.st_ino
    assert build().st_ino == wider.st_ino  # it holds more than is asked for
    assert build(["x86_64-darwin"]).st_ino != wider.st_ino


def test_backends_and_versions_replace_each_other(planar, tmp_path):
    def build(**options: str) -> bytes:
        return build_fmus(planar, tmp_path, units=["controller"], **options, folded=True)["controller"].read_bytes()

    python, native, native_3 = (
        build(backend="python"), build(backend="native"), build(backend="native", fmi_version="3.0"),
    )  # fmt: skip
    assert len({python, native, native_3}) == 3
    assert build(backend="python") == python
    assert build() == native  # the default
    assert sorted(tmp_path.iterdir()) == [tmp_path / "PDController.fmu"]


def test_a_second_build_compiles_nothing(planar, tmp_path, monkeypatch):
    first = build_fmus(planar, tmp_path / "1", units=FAST, backend="native", folded=True)
    monkeypatch.setattr(compile._Workshop, "_run", None)
    second = build_fmus(planar, tmp_path / "2", units=FAST, backend="native", folded=True)
    for unit, path in first.items():
        assert second[unit].read_bytes() == path.read_bytes()


@pytest.mark.parametrize("platform", [name for name, each in PLATFORMS.items() if each.libraries])
def test_a_library_may_have_memory_of_each_thread(platform, cold):
    """Functions of long arms have, which calls the system's loader on some platforms."""
    text = b'__attribute__((visibility("default"))) double *f(void) { static _Thread_local double k[9]; return k; }'
    assert b"libc.so.6" not in compile_library({"unit.c": text + b"\n"}, platform, name="Thread")


@pytest.mark.parametrize("damage", [b"", b"not a library"])
def test_a_damaged_cache_is_made_anew(damage, cold):
    first = compile_library(SMALL, this_platform(), name="Small")
    for file in (cold / "native").iterdir():
        file.write_bytes(damage)
    assert compile_library(SMALL, this_platform(), name="Small") == first


def test_a_missing_compiler_is_reported_with_the_fix(planar, tmp_path, cold, monkeypatch):
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    monkeypatch.setattr(platforms.shutil, "which", lambda name: None)
    kept = platforms.zig, platforms._compiler
    for each in kept:
        each.cache_clear()
    try:
        assert not native_available()
        with pytest.raises(FmuError, match=r"ziglang, which is not installed.*pip install .vdfmu\[native\]"):
            build_fmus(planar, tmp_path / "out", units=["controller"], backend="native", folded=True)
    finally:
        for each in kept:
            each.cache_clear()
    assert not (tmp_path / "out").exists()


def test_an_object_of_several_files_depends_on_each():
    keys = Compilation("a", SMALL | {"kernel_a.c": b""}, this_platform()).objects
    other = Compilation("a", SMALL | {"kernel_a.c": b"\n"}, this_platform()).objects
    assert keys.keys() == other.keys() and keys["together.c"] != other["together.c"]


def test_loops_over_joints_in_a_solver_step_are_not_unrolled():
    loop = "\n".join(rolled([f"w[{k}] = a[{k}];" for k in range(9)])).encode()
    for platform, step in (("x86_64-linux", "kernel_a_step_avx2.c"), ("aarch64-linux", "kernel_a_step.c")):
        for text, kept in ((loop, {step}), (b"", set())):
            job = Compilation("a", {"kernel_a_step.c": text, "kernel_a_step_avx2.c": b"", "unit.c": loop}, platform)
            optimised = {step, "unit.c"}
            assert {name for name in optimised if "-fno-unroll-loops" in job.flags_of(name)} == kept


@pytest.mark.heavy
def test_a_file_that_the_compiler_refuses_is_named(cold):
    sources = SMALL | {"kernel_bad.c": b"int bad(void) { return missing; }\n"}
    words = r"(?s)Plant for aarch64-linux: together.c cannot be compiled:.*kernel_bad.c.*identifier 'missing'"
    with pytest.raises(FmuError, match=words):
        compile_library(sources, "aarch64-linux", name="Plant")
    with pytest.raises(FmuError, match=r"(?s)Plant for aarch64-linux: Plant.so cannot be compiled:.*missing"):
        unresolved = b"int missing(void);\nint bad(void) { return missing(); }\n"
        compile_library({"unit.c": unresolved}, "aarch64-linux", name="Plant", flags=("-Wl,-z,defs",))


@pytest.mark.parametrize(("options", "words"), [
    ({"backend": "native", "platforms": ["x86_64-linux", "win64"]},
     r"no platform 'win64'. There are: x86_64-linux.*; and all\."),
    ({"platforms": ["all", "foo"]}, "no platform 'foo'"),  # platforms ask for native FMUs
    ({"backend": "native", "platforms": []}, "No platform is chosen"),
    ({"backend": "rust"}, "no backend 'rust'. There are: python, native"),
    ({"backend": "native", "fmi_version": "1.0"}, r"no FMI '1.0' here. There are: '2.0', '3.0'"),
    ({"backend": "python", "fmi_version": "3.0"}, r"Python FMUs have FMI 2.0, got 3.0"),
    ({"backend": "python", "platforms": "all"}, "Platforms can only be chosen for native FMUs"),
])  # fmt: skip
def test_unknown_names_are_refused_with_the_known_ones(planar, tmp_path, options, words):
    with pytest.raises(UsageError, match=words):
        build_fmus(planar, tmp_path, **options, folded=True)
    assert list(tmp_path.iterdir()) == []


def test_a_machine_without_native_fmus_is_reported(monkeypatch):
    monkeypatch.setattr(platforms.machine, "machine", lambda: "riscv64")
    with pytest.raises(FmuError, match=r"for this machine, riscv64-linux, only for x86_64-linux"):
        platforms.chosen_platforms(None)
    assert not native_available()
    assert platforms.chosen_platforms("all") == platforms.ALL
    assert platforms.chosen_platforms(["wasm32", "all"]) == tuple(PLATFORMS)


def test_a_cache_that_cannot_be_written_costs_time_alone(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert compile_library(SMALL, this_platform(), name="Small")


def test_a_full_disk_is_reported(monkeypatch, cold):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FmuError, match=r"cannot be compiled: .*No space left.*TMPDIR and VDFMU_CACHE_DIR"):
        compile_library(SMALL, this_platform(), name="Small")


@pytest.mark.heavy
def test_builds_at_the_same_time_do_not_meet(tmp_path):
    environment = os.environ | {"VDFMU_CACHE_DIR": str(tmp_path / "cache")}
    folders = [tmp_path / str(i) for i in range(3)]
    processes = [subprocess.Popen([sys.executable, "-c", BUILD, str(folder)], env=environment) for folder in folders]
    assert [process.wait(300) for process in processes] == [0, 0, 0]
    for name in ("Trajectory.fmu", "PDController.fmu"):
        assert len({(folder / name).read_bytes() for folder in folders}) == 1
