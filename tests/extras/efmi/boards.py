"""Production code on microcontrollers, which QEMU emulates: outputs, memory and instructions.

``python -m tests.extras.efmi.boards`` prints the table of docs/efmi.md.
"""

import struct
import sys
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.compiler.native.conftest import program, run
from tests.extras.efmi.conftest import SINGLE, build
from tests.extras.efmi.efmu import Efmu, Rows
from tests.extras.efmi.runs import ScenarioRun, experiment, of_fmu
from vdfmu.extras.efmi.production import PRECISIONS

HERE = Path(__file__).parent / "board"
NEWLIB = Path("/usr/lib/arm-none-eabi/newlib/thumb")
"""Math library of the Debian package libnewlib-arm-none-eabi."""
FOUND = struct.Struct("<7I4xQ")
_TICK = 40 / 32
"""Instructions in a tick of 25 MHz, at 32 ns each."""


@dataclass(frozen=True)
class Board:
    """A board of QEMU with its processor."""

    name: str
    machine: str
    cpu: str
    """Processor as zig calls it, whose own model has no floating-point unit."""
    library: str
    """Folder of the math library."""
    rows: int
    """Address of the memory for the inputs."""


BOARDS = (
    Board("Cortex-M4F", "mps2-an386", "cortex_m4+vfp4d16sp", "v7e-m+fp/hard", 0x21000000),
    Board("Cortex-M7", "mps2-an500", "cortex_m7+fp_armv8d16", "v7e-m+dp/hard", 0x60000000),
)


class OnBoard(NamedTuple):
    """What a run on a board gave: bytes, and instructions of a step."""

    outputs: Rows
    signals: int
    code: int
    """Code and constants of the block."""
    flash: int
    """That of the whole program, with the math library and, where there is no unit for it, arithmetic."""
    ram: int
    stack: int
    mean: float
    most: float


def on_board(efmu: Efmu, board: Board, inputs: Rows, folder: Path) -> OnBoard:
    if not (NEWLIB / board.library / "libm.a").exists():
        program("arm-none-eabi-newlib", "libnewlib-arm-none-eabi")
    qemu = program("qemu-system-arm", "qemu-system-arm")
    kind = np.float64 if b"typedef double" in efmu.code[f"{efmu.name}.h"] else np.float32
    for name, text in efmu.code.items():
        (folder / name).write_bytes(text)
    outputs = {name: efmu.size(name) for name in efmu.names("output")}
    widths = {name: efmu.size(name) for name in efmu.names("input")}
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "thumb-freestanding-eabihf", f"-mcpu={board.cpu}", "-O2"]
    # with its own name for the folder of the headers: else zig takes an object that it made with others
    flags = [
        "-ffp-contract=off", "-ffunction-sections", "-fdata-sections", f"-I{folder}", "-isystem",
        "/usr/include/newlib",
    ]  # fmt: skip
    defined = {"UNIT": efmu.name, "INPUTS": sum(widths.values()), "OUTPUTS": sum(outputs.values()), "ROWS": board.rows}
    run([*zig, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", *flags, "-c",
         f"{efmu.name}.c", "-o", "unit.o"], cwd=folder, seconds=600)  # fmt: skip
    run([*zig, "-std=gnu99", *flags, *(f"-D{name}={value}" for name, value in defined.items()), "-c",
         HERE / "board.c", "-o", "board.o"], cwd=folder, seconds=600)  # fmt: skip
    libraries = [NEWLIB / board.library / f"lib{name}.a" for name in "mc"]
    run([*zig, "-Wl,--gc-sections", "-Wl,--entry=reset", f"-Wl,-T,{HERE / 'mps2.ld'}", "board.o", "unit.o",
         *libraries, "-o", "image.elf"], cwd=folder, seconds=600)  # fmt: skip
    steps = max(len(values) for values in inputs.values())
    columns = [inputs.get(name, np.zeros((steps, size))) for name, size in widths.items()]
    np.concatenate(columns, axis=1).astype(kind).tofile(folder / "inputs.bin")
    run([qemu, "-M", board.machine, "-kernel", "image.elf", "-display", "none", "-monitor", "none", "-serial", "none",
         "-semihosting-config", "enable=on,target=native", "-icount", "shift=5"], cwd=folder, seconds=600)  # fmt: skip
    done, _, most, _, ram, stack, signals, total = FOUND.unpack((folder / "found.bin").read_bytes())
    assert done == steps, f"{done} of {steps} steps"
    made = np.fromfile(folder / "outputs.bin", dtype=kind).astype(float).reshape(steps, -1)
    places = np.cumsum([0, *outputs.values()])
    split = {name: made[:, a:b] for name, a, b in zip(outputs, places, places[1:], strict=False)}
    code, flash = _kept(folder / "unit.o"), _kept(folder / "image.elf")
    return OnBoard(split, signals, code, flash, ram, stack, _TICK * total / steps, _TICK * most)


def _kept(elf: Path) -> int:
    """Bytes that the sections of a file take in flash: what is loaded, code or data."""
    content = elf.read_bytes()
    (at,) = struct.unpack_from("<I", content, 0x20)
    size, count = struct.unpack_from("<2H", content, 0x2E)
    sections = (struct.unpack_from("<10I", content, at + k * size) for k in range(count))
    loaded, exception, nobits = 2, 0x70000001, 8  # SHF_ALLOC, SHT_ARM_EXIDX, SHT_NOBITS
    return sum(s[5] for s in sections if s[2] & loaded and s[1] not in (nobits, exception))


COLUMNS = (
    "unit", "numbers", "processor", "code", "flash", "RAM", "stack", "instructions, mean", "worst", "error",
)  # fmt: skip


def row(path: Path, precision: str, board: Board, inputs: Rows, expected: Rows) -> str:
    """Row of the table: a unit on a board, with the error of its first output."""
    efmu = Efmu(path)
    with tempfile.TemporaryDirectory() as folder:
        made = on_board(efmu, board, inputs, Path(folder))
    assert made.signals == 0, efmu.name
    name = efmu.names("output")[0]
    error = np.max(np.abs(made.outputs[name] - expected[name])) / np.max(np.abs(expected[name]))
    numbers = (made.code, made.flash, made.ram, made.stack, round(made.mean), round(made.most))
    cells = [efmu.name, precision, board.name, *(f"{n:,}" for n in numbers), f"{error:.1g}"]
    return f"| {' | '.join(cells)} |"


def table() -> str:
    head = [f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}"]
    rows, motion_rows = [*head], ["", *head]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        whole = ScenarioRun("tracking", folder)
        fmus = {precision: whole.efmus(folder / precision, precision) for precision in PRECISIONS}
        for name in ("controller", "feedforward"):
            for precision, board in product(PRECISIONS, BOARDS):
                path = fmus[precision][name]
                efmu = Efmu(path)
                rows.append(row(path, precision, board, whole.inputs(name, efmu), whole.outputs(name, efmu)))
        for name in SINGLE:
            for precision, board in zip(PRECISIONS, reversed(BOARDS), strict=True):
                path = build(name, "manipulator_6dof", precision, folder / f"{name}_{precision}")
                inputs = experiment(Efmu(path), 1000)
                if inputs and name not in ("controller", "feedforward"):
                    motion_rows.append(row(path, precision, board, inputs, of_fmu(path, inputs, 1000)))
    return "\n".join(rows + motion_rows)


if __name__ == "__main__":
    print(table())
