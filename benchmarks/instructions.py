"""Instructions of a step of the plant, by part, counted by callgrind: ``python -m benchmarks.instructions``.

The paper's arm falls from rest for 200 steps of 1 ms. Instructions depend on the compiler, not on the load of the
machine. Needs valgrind.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from zipfile import ZipFile

from fmpy import read_model_description
from rich.console import Console

import vdfmu
from benchmarks.report import Table
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units.plant import Plant
from vdfmu.compiler.fmu.native import fmi_headers
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import Integrator

ROBOT, STEPS = "manipulator_6dof", 200
PARTS = {
    "elementary functions": "elementary.h",
    "right side, Jacobian and factors at the start of a step": "plant_step_start",
    "right sides of the stages": "plant_step_balance",
    "solution of the stages' linear equations": "plant_step_solve",
    "sums over stages, copies, error": "kernel_plant_step",
    "step control, outputs, FMI": "",
}
"""Part to a word in the file and name of its functions; the first that fits counts."""
_COST = re.compile(r"^ *([\d,]+) \([ \d.]+%\)  (\S+:\S+)", re.MULTILINE)


def library_of(folder: Path) -> tuple[Path, str]:
    """Compile the plant as a run has it, with the names of its functions; return the library and its GUID."""
    fmu = build_fmus(vdfmu.load_robot(ROBOT), folder, units=Plant, folded=True)["plant"]
    guid = str(read_model_description(fmu).guid)
    with ZipFile(fmu) as archive:
        archive.extractall(folder)
    for name, content in fmi_headers("2.0").items():
        (folder / "sources" / name).write_bytes(content)
    library, files = folder / "plant.so", sorted(folder.glob("sources/*.c"))
    flags = ["-std=c11", "-O3", "-march=x86_64_v2", "-ffp-contract=off", "-fno-math-errno", "-g", "-fPIC", "-shared"]
    flags += ["-DDISABLE_PREFIX", f"-I{folder / 'sources'}", "-o", str(library)]
    _zig("cc", *flags, *(str(each) for each in files if each.name != "fmi3.c"))
    return library, guid


def _zig(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "ziglang", *arguments], check=True)


def counted(folder: Path, library: Path, guid: str) -> Counter[str]:
    """Return the instructions of each part over all steps."""
    program, profile = folder / "fall", folder / "profile"
    source = Path(__file__).with_suffix(".c")
    _zig("cc", "-O1", f"-I{folder / 'sources'}", str(source), "-o", str(program))
    command = ["valgrind", "--tool=callgrind", "--toggle-collect=fmi2DoStep", f"--callgrind-out-file={profile}"]
    subprocess.run([*command, str(program), str(library), guid, str(STEPS)], check=True, capture_output=True)
    text = subprocess.run(
        ["callgrind_annotate", "--threshold=100", "--auto=no", str(profile)], check=True, capture_output=True, text=True
    ).stdout
    costs = Counter[str]()
    for cost, name in _COST.findall(text):
        costs[next(part for part, word in PARTS.items() if word in name)] += int(cost.replace(",", ""))
    return costs


def internal_steps(tolerance: float) -> tuple[int, int]:
    """Return accepted and rejected internal steps of the same fall."""
    unit = Traced(Interface(Plant, vdfmu.load_robot(ROBOT)))
    unit.start()
    solver = Integrator(unit)
    solver.tolerance = tolerance
    for k in range(STEPS):
        solver.move(k * 1e-3, (k + 1) * 1e-3)
    return solver.steps, solver.rejected


def main() -> None:
    """Count and print."""
    with tempfile.TemporaryDirectory() as name:
        costs = counted(Path(name), *library_of(Path(name)))
    whole = costs.total()
    taken = {tolerance: internal_steps(tolerance) for tolerance in (1e-5, 1e-6, 1e-7, 1e-8)}
    parts = Table("parts", "Instructions of a step", [("part", ""), ("instructions", ",.0f"), ("share [%]", ".1f")])
    for part in PARTS:
        parts.add(part, costs[part] / sum(taken[1e-7]), 100.0 * costs[part] / whole)
    falls = Table("falls", "Internal steps in 1 ms", [("tolerance", "g"), ("accepted", ".1f"), ("rejected", ".1f")])
    for tolerance, (accepted, rejected) in taken.items():
        falls.add(tolerance, accepted / STEPS, rejected / STEPS)
    for table in (parts, falls):
        table.show(Console())


if __name__ == "__main__":
    main()
