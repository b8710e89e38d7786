"""The platforms of native FMUs, compiler target, folders and file names, and the program that compiles for them."""

from __future__ import annotations

import platform as machine
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.standards import FMI_VERSIONS


@dataclass(frozen=True)
class Platform:
    """One platform.

    Attributes
    ----------
    name : str
        Platform tuple of FMI 3.0, which names its folder in ``binaries/``; of WebAssembly the processor alone, as the
        module asks no system for anything.
    target : str
        Target of zig: the oldest system on which the library loads.
    folder_2 : str
        Folder in FMI 2.0. It has names of its own for x86; others are platform tuples (FMI 2.0.4, section 2.3).
    suffix : str
        Suffix of the library.
    flags : tuple of str
        Flags of the compiler.
    link : tuple of str
        Flags of the linker.
    libraries : mapping of str to mapping of str to str
        The system's libraries: file, then version of its functions, then the functions that may be called, separated
        by spaces. The linker needs no more of them. Without any it takes zig's own, which zig compiles first.
    """

    name: str
    target: str
    folder_2: str
    suffix: str
    flags: tuple[str, ...] = ()
    link: tuple[str, ...] = ("-shared",)
    libraries: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])


X86 = ("-march=x86_64_v2",)
"""Flags of the platforms with processors of x86."""
WASM = "wasm32"
"""Name of the platform of WebAssembly: a module with the functions of FMI in C."""
_MODULE = (
    "-mexec-model=reactor", "-Wl,--export=malloc", "-Wl,--export=free", "-Wl,--export-table", "-Wl,--growable-table",
)  # fmt: skip
"""A module with memory for their arguments, and a table that takes the importer's callbacks."""
_MATH = (
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh exp exp10 exp2 expm1 fabs floor fma fmax fmin "
    "fmod frexp hypot ldexp log log10 log1p log2 nearbyint pow rint round sin sincos sinh sqrt tan tanh trunc"
)
_C = (
    "bcmp calloc free malloc memccpy memchr memcmp memmove mempcpy memset realloc snprintf stpcpy strcat strchr strcmp "
    "strcpy strcspn strlen strncat strncmp strncpy strnlen strpbrk strrchr strspn strstr strtod vsnprintf"
)
"""What the C of units, and of benchmarks, calls, and what the compiler may make of it."""
# fmt: off
PLATFORMS = {
    p.name: p
    for p in (
        Platform(
            "x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so", X86,
            libraries={
                "libm.so.6": {"GLIBC_2.2.5": _MATH},
                "libc.so.6": {"GLIBC_2.2.5": _C, "GLIBC_2.14": "memcpy", "GLIBC_2.17": "clock_gettime"},
                "ld-linux-x86-64.so.2": {"GLIBC_2.3": "__tls_get_addr"},  # memory that each thread has of its own
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
"""Platforms that ``all`` means: importers of native FMUs load their libraries."""

_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def this_platform() -> str:
    """Name of this machine's platform.

    Raises
    ------
    FmuError
        If native FMUs cannot be built for it.
    """
    found = machine.machine()
    name = f"{_MACHINES.get(found.lower(), found)}-{_SYSTEMS.get(sys.platform, sys.platform)}"
    if name not in PLATFORMS:
        raise FmuError(f"there are no native FMUs for this machine, {name}. There are: {', '.join(PLATFORMS)}.")
    return name


def chosen_platforms(chosen: Sequence[str] | str | None) -> tuple[str, ...]:
    """Names of platforms, in the order of :data:`PLATFORMS`.

    Parameters
    ----------
    chosen : sequence of str, str or None
        Names; ``"all"`` for :data:`ALL`; None for this machine's.

    Raises
    ------
    UsageError
        If one does not exist, or none is chosen.
    FmuError
        See :func:`this_platform`.
    """
    if chosen is None:
        return (this_platform(),)
    names = [chosen] if isinstance(chosen, str) else list(chosen)
    unknown = [name for name in names if name not in (*PLATFORMS, "all")]
    if unknown or not names:
        what = f"There is no platform {unknown[0]!r}." if unknown else "No platform is chosen."
        raise UsageError(f"{what} There are: {', '.join(PLATFORMS)}; and all.")
    return tuple(name for name in PLATFORMS if name in names or ("all" in names and name in ALL))


def binaries(model_name: str, libraries: Mapping[str, bytes], fmi_version: str) -> dict[str, bytes]:
    """Path in the FMU to content, for libraries by platform.

    Importers of FMI 2.0 on Arm may look into the folder of their system's x86: fmpy and OpenModelica do. So
    ``darwin64`` holds a library for both processors where both are chosen, and ``linux64`` that for Arm where
    there is no other.
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
    """Universal binary of macOS: a header, then the library of each processor on a page of its own."""
    page = 14  # 2^14 bytes, a page of the larger of the two
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
    """Whether native FMUs can be built and run here: whether the compiler is installed."""
    try:
        this_platform()
        zig()
    except FmuError:
        return False
    return True


def compiler_version() -> str:
    """Name and version of the compiler; its name alone where it is not installed."""
    try:
        return f"ziglang {version('ziglang')}"
    except PackageNotFoundError:
        return "ziglang"


@lru_cache
def zig() -> str:
    """Path of the compiler's program."""
    spec = find_spec("ziglang")
    for folder in (spec.submodule_search_locations if spec else None) or ():
        for name in ("zig", "zig.exe"):
            if (program := Path(folder) / name).is_file():
                return str(program)
    raise FmuError(
        "native FMUs need the C compiler of the package ziglang, which is not installed. Install it with "
        "`pip install 'vdfmu[native]'`, or build with the backend `python`."
    )
