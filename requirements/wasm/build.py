"""Compile ``fmu_src/batch/module.c`` with functions of wasi-libc to ``module.wasm``, and put the licences beside it."""

import subprocess
import tempfile
from pathlib import Path

from vdfmu.base.compile import SHOWN
from vdfmu.base.files import data_path
from vdfmu.base.platforms import zig
from vdfmu.compiler.wasm import IMPORTED

FLAGS = (
    "-target", "wasm32-wasi", "-mexec-model=reactor", "-std=c11", "-O2", "-g0", "-s", "-fno-math-errno",
    "-fno-sanitize=undefined", "-Wall", "-Wextra", "-Werror",
    "-Wl,-z,stack-size=65536,--initial-memory=131072,--export-table,--growable-table",
)  # fmt: skip


def build() -> bytes:
    """Return the module."""
    folder = data_path("fmu_src")
    exports = [f"-Wl,--export={name}" for name in sorted(IMPORTED)]
    with tempfile.TemporaryDirectory() as place:
        Path(place, "shown.h").write_text(SHOWN)
        headers = [f"-I{path}" for path in (place, folder / "c", folder / "functions")]
        source, out = folder / "batch" / "module.c", Path(place, "module.wasm")
        subprocess.run([zig(), "cc", *FLAGS, *exports, *headers, "-o", out, source], check=True)
        return out.read_bytes()


def licences() -> str:
    """Return the licences of the functions of the C library."""
    libraries = Path(zig()).parent / "lib" / "libc" / "wasi"
    return "\n\n".join((libraries / name).read_text() for name in ("LICENSE", "libc-top-half/musl/COPYRIGHT"))


if __name__ == "__main__":
    folder = data_path("fmu_src") / "batch"
    (folder / "module.wasm").write_bytes(build())
    (folder / "module.LICENSE").write_text(licences())
