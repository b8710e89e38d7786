"""Command line of the benchmarks: ``python -m benchmarks [NAME ...] [--quick] [--out FOLDER]``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console

from benchmarks.report import Report
from benchmarks.timing import processor_time
from vdfmu.base.platforms import native_available

NAMES = (
    "fmu_growth", "coupling", "native", "interop", "work_precision", "engines", "whole", "sweeps", "arms", "verdict",
    "kr300", "exporters", "environments",
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the chosen benchmarks; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure vdfmu. Prints tables; writes Markdown.",
        epilog="example: python -m benchmarks native --quick",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which, of {', '.join(NAMES)}; default all")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="shorter runs and fewer sizes, under a minute in all where everything is built",
    )
    parser.add_argument("--out", type=Path, default=Path("results/bench"), help="where to write; default %(default)s")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in NAMES]
    if unknown:
        parser.error(f"there is no benchmark {unknown[0]!r}; there are {', '.join(NAMES)}")  # exits with 2
    if not native_available():
        parser.error("the compiler of native FMUs is not installed (pip install .[native])")
    options.out.mkdir(parents=True, exist_ok=True)
    console = Console(width=None if sys.stdout.isatty() else 120)
    for name in options.names or NAMES:
        module = import_module(f"benchmarks.{name}")
        report = Report(name, module.TITLE, options.out, console)
        console.rule(f"[bold]{module.TITLE}", align="left")
        began, cpu_began = time.perf_counter(), processor_time()
        module.run(report, options.quick)
        report.write()
        wall, cpu = time.perf_counter() - began, processor_time() - cpu_began
        report.say(f"{name}: {wall:.0f} s, file {options.out / name}.md")
        if cpu < 0.9 * wall:
            report.say(f"The machine was busy: {cpu:.0f} s of processor time in {wall:.0f} s. Wall times are too long.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
