"""Compile ``fmu_src/batch/module.c`` to ``module.wasm``."""

import subprocess
import tempfile
from pathlib import Path

from vdfmu.base.compile import support_folder
from vdfmu.base.files import data_path
from vdfmu.base.platforms import compiler

FLAGS = (
    "-target", "wasm32-wasi", "-mexec-model=reactor", "-mbulk-memory", "-std=c11", "-O2", "-g0", "-s",
    "-ffp-contract=off", "-fno-math-errno", "-fno-sanitize=undefined", "-Wall", "-Wextra", "-Werror",
    "-Wl,-z,stack-size=65536,--initial-memory=131072,--export-table,--growable-table",
)  # fmt: skip


def build() -> bytes:
    """Return the module."""
    folder, zig = data_path("fmu_src"), compiler()
    with tempfile.TemporaryDirectory() as place:
        headers = [f"-I{folder / name}" for name in ("c", "functions")]
        source, out = folder / "batch" / "module.c", Path(place, "module.wasm")
        caches = {"ZIG_LOCAL_CACHE_DIR": place, "ZIG_GLOBAL_CACHE_DIR": support_folder(Path(place))}
        command = [*zig.command, *FLAGS, *headers, "-o", out, source]
        subprocess.run(command, check=True, env={**zig.environment, **caches})
        return out.read_bytes()


if __name__ == "__main__":
    (data_path("fmu_src") / "batch" / "module.wasm").write_bytes(build())
