"""The platforms of native FMUs, with targets of the compiler, folders and file names, and the compiler itself."""

from __future__ import annotations

import os
import platform as machine
import shutil
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.standards import FMI_VERSIONS

THIRD_PARTY = """
The libraries in binaries/ contain parts of the run-time support of the compiler zig: compiler-rt (Apache-2.0 WITH
LLVM-exception) and zig (MIT); those for Windows also parts of mingw-w64 (ZPL-2.1 and public domain), those for
WebAssembly of wasi-libc (Apache-2.0 WITH LLVM-exception) and in it musl (MIT, Copyright 2005-2020 Rich Felker, et al.).
"""
"""Licences of the compiler's code in the libraries of FMUs."""


@dataclass(frozen=True)
class Platform:
    """A platform, with the flags of its compiler and its linker."""

    name: str
    """Platform tuple of FMI 3.0 and folder in ``binaries/``. WebAssembly has no operating system, so it is named by its
    processor."""
    target: str
    """Target of zig: the oldest system on which the library loads."""
    folder_2: str
    """Folder in FMI 2.0: the standard's name for x86, else the platform tuple (FMI 2.0.4, section 2.3)."""
    suffix: str
    flags: tuple[str, ...] = ()
    link: tuple[str, ...] = ("-shared",)
    libraries: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    """Functions of the system's libraries by file and symbol version, separated by spaces. They are all that the linker
    needs; without them zig first compiles its own libraries."""


X86 = ("-march=x86_64_v2",)
"""Flags of the platforms with x86 processors."""
WASM = "wasm32"
"""Platform of WebAssembly: a module with the functions of FMI in C."""
_MODULE = (
    "-mexec-model=reactor",
    "-Wl,--export=malloc",
    "-Wl,--export=free",
    "-Wl,--export-table",
    "-Wl,--growable-table",
)
"""The module also exports its memory, for arguments, and a table for the importer's callbacks."""
_MATH = (
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh exp exp10 exp2 expm1 fabs floor fma fmax fmin "
    "fmod frexp hypot ldexp log log10 log1p log2 nearbyint pow rint round sin sincos sinh sqrt tan tanh trunc"
)
_C = (
    "bcmp calloc free malloc memccpy memchr memcmp memmove mempcpy memset realloc snprintf stpcpy strcat strchr strcmp "
    "strcpy strcspn strlen strncat strncmp strncpy strnlen strpbrk strrchr strspn strstr strtod vsnprintf"
)
"""Functions that the C code of units and benchmarks calls, and functions that the compiler may call instead."""
# fmt: off
PLATFORMS = {
    p.name: p
    for p in (
        Platform(
            "x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so", X86,
            libraries={
                "libm.so.6": {"GLIBC_2.2.5": _MATH},
                "libc.so.6": {"GLIBC_2.2.5": _C, "GLIBC_2.14": "memcpy", "GLIBC_2.17": "clock_gettime"},
                "ld-linux-x86-64.so.2": {"GLIBC_2.3": "__tls_get_addr"},  # thread-local memory
            },
        ),
        Platform(
            "aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so",
            libraries={"libm.so.6": {"GLIBC_2.17": _MATH}, "libc.so.6": {"GLIBC_2.17": f"{_C} memcpy clock_gettime"}},
        ),
        Platform("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll", X86),
        Platform("x86_64-darwin", "x86_64-macos.11.0", "darwin64", ".dylib", X86),
        Platform("aarch64-darwin", "aarch64-macos.11.0", "aarch64-darwin", ".dylib"),
        Platform(WASM, "wasm32-wasi", WASM, ".wasm", (), _MODULE),
    )
}
# fmt: on
"""Name to platform."""
ALL = tuple(name for name in PLATFORMS if name != WASM)
"""Platforms that ``all`` means: those on which importers load native FMUs."""

_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def this_platform() -> str:
    """Return the name of this machine's platform. FmuError if native FMUs cannot be built for it."""
    processor = machine.machine()
    name = f"{_MACHINES.get(processor.lower(), processor)}-{_SYSTEMS.get(sys.platform, sys.platform)}"
    if name not in PLATFORMS:
        raise FmuError(f"there are no native FMUs for this machine, {name}, only for {', '.join(PLATFORMS)}.")
    return name


def chosen_platforms(chosen: Sequence[str] | str | None) -> tuple[str, ...]:
    """Return names of platforms, in the order of :data:`PLATFORMS`.

    `chosen`: names, ``"all"`` for :data:`ALL`, or None for :func:`this_platform`. UsageError for an unknown name or an
    empty list.
    """
    if chosen is None:
        return (this_platform(),)
    names = [chosen] if isinstance(chosen, str) else list(chosen)
    unknown = [name for name in names if name not in (*PLATFORMS, "all")]
    if unknown or not names:
        problem = f"There is no platform {unknown[0]!r}." if unknown else "No platform is chosen."
        raise UsageError(f"{problem} There are: {', '.join(PLATFORMS)}; and all.")
    return tuple(name for name in PLATFORMS if name in names or ("all" in names and name in ALL))


def binaries(model_name: str, libraries: Mapping[str, bytes], fmi_version: str) -> dict[str, bytes]:
    """Return the content by path in the FMU for libraries by platform.

    On Arm, importers of FMI 2.0 such as fmpy and OpenModelica may read the folder for x86. So ``darwin64`` contains a
    library for both processors if both are chosen, and without a library for x86 its folder contains the one for Arm.
    """
    files: dict[str, bytes] = {}
    tuples = FMI_VERSIONS[fmi_version].platform_tuples

    def add(folder: str, platform: str, content: bytes) -> None:
        files[f"binaries/{folder}/{model_name}{PLATFORMS[platform].suffix}"] = content

    for name, content in libraries.items():
        add(name if tuples else PLATFORMS[name].folder_2, name, content)
    if not tuples:
        for system in ("linux", "darwin"):
            arm, x86 = f"aarch64-{system}", f"x86_64-{system}"
            if arm in libraries and x86 not in libraries:
                add(PLATFORMS[x86].folder_2, arm, libraries[arm])
            elif arm in libraries and system == "darwin":
                add(PLATFORMS[x86].folder_2, x86, _universal(libraries[x86], libraries[arm]))
    return files


def _universal(x86: bytes, arm: bytes) -> bytes:
    """Return a universal binary for macOS: a header, then the library of each processor, aligned to pages."""
    page = 14  # 2^14 bytes, the larger page size of the two processors
    processors = ((0x01000007, 3, x86), (0x0100000C, 0, arm))
    header = struct.pack(">II", 0xCAFEBABE, len(processors))
    body = b""
    end = 1 << page
    for cpu, subtype, content in processors:
        offset = -(-end >> page) << page
        header += struct.pack(">IIIII", cpu, subtype, offset, len(content), page)
        body += bytes(offset - end) + content
        end = offset + len(content)
    return header.ljust(1 << page, b"\0") + body


def native_available() -> bool:
    """Whether native FMUs can be built and run here, with the compiler installed."""
    try:
        compiler(this_platform())
    except FmuError:
        return False
    return True


CHOICE = "VDFMU_COMPILER"
"""Environment variable that chooses the compiler for this machine: ``zig``, or a program such as ``gcc``."""
_PROGRAMS = ("cc", "gcc", "clang")
"""Programs that are tried if ziglang is not installed."""
_WORDS = {
    "-march=x86_64_v2": "-march=x86-64-v2",
    "-fno-slp-vectorize": "-fno-tree-slp-vectorize",
    "-fno-vectorize": "-fno-tree-vectorize",
    "-Xclang": "",
}
"""Flags of zig to the flags of gcc and clang."""


class Compiler(NamedTuple):
    """A C compiler: its name with version, its command, and whether it is zig, which compiles for every platform."""

    name: str
    command: tuple[str, ...]
    is_zig: bool

    @property
    def identity(self) -> str:
        """Key that distinguishes its libraries from those of other compilers. Zig's version decides all its parts."""
        return self.name if self.is_zig else f"{self.name} {self.command[0]}"

    @property
    def environment(self) -> dict[str, str]:
        """All environment variables of its processes."""
        return _environment(self.command[0])

    def arguments(self, target: Platform, flags: Sequence[str]) -> list[str]:
        """Return the arguments of a call with zig's flags."""
        if self.is_zig:
            return ["-target", target.target, *flags]
        return ["-fPIC", *filter(None, (_WORDS.get(flag, flag) for flag in flags))]


def _environment(program: str) -> dict[str, str]:
    """Return the environment of the processes of a compiler, which depends only on the path of its program.

    Compilers read many variables: CPATH and C_INCLUDE_PATH add headers, COMPILER_PATH and PATH replace the assembler,
    CCC_OVERRIDE_OPTIONS changes options. A library may depend only on what its key in the cache contains, so none of
    the user's variables is passed on. Messages are in English, because they are searched for English words.
    """
    if sys.platform == "win32":
        return {"SYSTEMROOT": os.environ.get("SYSTEMROOT", r"C:\Windows")}
    return {"LC_ALL": "C", "PATH": f"{Path(program).parent}:{os.defpath}"}


def compiler(platform: str = "") -> Compiler:
    """Return the compiler for a platform.

    For this machine it is the one that `CHOICE` names, by default ziglang, or a C compiler of the system if ziglang is
    not installed. Other platforms and Windows need ziglang. FmuError if no compiler is installed, UsageError if the
    chosen program is not gcc or clang.
    """
    native = platform == this_platform() and sys.platform != "win32"
    return _compiler(os.environ.get(CHOICE, "") if native else "zig")


@lru_cache
def _compiler(chosen: str) -> Compiler:
    """Return the compiler of a choice; "" is the default."""
    if chosen == "zig" or (not chosen and find_spec("ziglang")):
        names = sorted(each.stem for each in Path(zig()).parents[1].glob("ziglang-*-info"))
        if not names:
            from importlib.metadata import version  # takes 10 ms to import

            names = [f"ziglang {version('ziglang')}"]
        return Compiler(" ".join(names).replace("-", " "), (zig(), "cc"), True)
    for program in filter(None, map(shutil.which, (chosen,) if chosen else _PROGRAMS)):
        path = os.path.abspath(program)
        processor = _MACHINES.get(_answer(path, "-dumpmachine").partition("-")[0])
        if processor == _MACHINES.get(machine.machine().lower(), ""):
            return Compiler(_answer(path, "--version").splitlines()[0], (path,), False)
    if chosen:
        raise UsageError(f"compiler must be zig or a gcc or clang for this machine, got {chosen!r}. Install it.")
    raise FmuError(_NO_COMPILER)


def _answer(program: str, question: str) -> str:
    """Return the output of a program."""
    return subprocess.run(
        [program, question], stdin=subprocess.DEVNULL, capture_output=True, text=True, env=_environment(program)
    ).stdout


def compiler_version() -> str:
    """Return the name and version of the compiler for this machine, or None."""
    return compiler(this_platform()).name if native_available() else "no compiler"


_NO_COMPILER = (
    "native FMUs need gcc, clang, or the C compiler of the package ziglang, which is not installed. Install it with "
    "`pip install 'vdfmu[native]'`, or build with the backend `python`."
)


@lru_cache
def zig() -> str:
    """Path of zig's program. FmuError if it is not installed."""
    spec = find_spec("ziglang")
    for folder in (spec.submodule_search_locations if spec else None) or ():
        for name in ("zig", "zig.exe"):
            if (program := Path(folder) / name).is_file():
                return str(program)
    raise FmuError(
        "native FMUs for other platforms need the C compiler of the package ziglang, which is not installed. Install "
        "it with `pip install 'vdfmu[native]'`."
    )
