"""Seed faults into the package and see whether ``make test`` finds them: ``python -m tests.mutants [WORD ...]``.

Each fault of `mutants.txt` is a line that is changed in a copy of the tree, where first the tests of its room run, then
all others, until one fails. Faults are chosen at random over equations, compiler, engine, results, studies and checker,
so a few change no result; those are marked ``same`` there. WORD chooses faults by their file.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
_LIST = Path(__file__).with_suffix(".txt")
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
_PATIENCE = 1200
"""Seconds after which the tests are taken to hang, which finds a fault too."""
_NEEDED = ("vdfmu", "tests", "models", "ssp", "fmu_src", "examples", "benchmarks", "docs", "requirements")


class Fault(NamedTuple):
    """A line of a file that becomes another."""

    file: str
    line: str
    changed: str
    same: bool
    """Whether it changes no result."""


def faults() -> list[Fault]:
    listed: list[Fault] = []
    for block in _LIST.read_text(encoding="utf-8").strip().split("\n\n"):
        head, line, changed = block.split("\n")
        file, _, same = head.partition(" ")
        fault = Fault(file, line.removeprefix("- "), changed.removeprefix("+ "), same == "same")
        count = [each.strip() for each in (ROOT / file).read_text(encoding="utf-8").splitlines()].count(fault.line)
        if count != 1:
            raise ValueError(f"{_LIST.name}: {file}: expected one line {fault.line!r}, got {count}")
        listed.append(fault)
    return listed


def first_failure(fault: Fault) -> str:
    """Return the first test that fails with a fault; empty if none does."""
    with tempfile.TemporaryDirectory(prefix="vdfmu_mutant_") as place:
        tree = Path(place)
        for name in _NEEDED:
            shutil.copytree(ROOT / name, tree / name)
        for path in ROOT.iterdir():
            if path.is_file():
                shutil.copy(path, tree)
        file = tree / fault.file
        lines = file.read_text(encoding="utf-8").split("\n")
        (k,) = (k for k, line in enumerate(lines) if line.strip() == fault.line)
        lines[k] = lines[k].replace(fault.line, fault.changed)
        file.write_text("\n".join(lines), encoding="utf-8")
        room = f"tests/{fault.file.split('/')[1]}"
        for chosen in ([room], ["tests", f"--ignore={room}", "--ignore=tests/test_mutants.py"]):
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "-m", "not heavy", *chosen]
            environment = os.environ | {"PYTHONPATH": place}
            run = subprocess.Popen(
                command, cwd=tree, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
            try:
                shown, _ = run.communicate(timeout=_PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, signal.SIGKILL)
                run.communicate()
                return f"no end within {_PATIENCE} s"
            if run.returncode:
                match = _FAILED.search(shown)
                return match[1] if match else f"exit code {run.returncode}"
    return ""


def main(words: list[str]) -> int:
    """Try the faults, and print what finds each; return how many are missed, at most 1."""
    missed = 0
    for fault in faults():
        if words and not any(word in fault.file for word in words):
            continue
        began = time.monotonic()
        test = first_failure(fault)
        missed += not test and not fault.same
        result = test or ("same" if fault.same else "MISSED")
        print(f"{time.monotonic() - began:5.0f} s  {fault.file}: {fault.changed[:70]}\n         {result}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
