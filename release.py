"""Make a release: ``make release``. It takes SOURCE_DATE_EPOCH or a fixed date, and twice gives the same bits.

``dist/vdfmu-VERSION`` gets the wheel, the sdist, the bill of materials that ``make sbom`` wrote, and for each arm the
FMUs of its units in FMI 2.0 and 3.0 for all platforms, a first motion as SSP 1.0 and 2.0, and reference results of it.
SHA256SUMS has the digest of each file: ``sha256sum -c SHA256SUMS``.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.base.standards import FMI_3, FMI_VERSIONS
from vdfmu.base.version import __version__
from vdfmu.compiler.c.platforms import COMPONENT, PLATFORMS
from vdfmu.study.analysis.reach import reach_scenario
from vdfmu.study.run.reference_folder import write_reference
from vdfmu.system.scenario.values import system_values

ROOT = Path(__file__).parent
SBOM = ROOT / "dist" / "sbom.cdx.json"
EPOCH = "1577836800"
"""Date of the files in archives where SOURCE_DATE_EPOCH says none: 1 January 2020, as of hatchling."""


def make(out: Path, arms: Sequence[str], platforms: Sequence[str]) -> None:
    """Write a release into a folder, which is emptied first."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    environment = {"SOURCE_DATE_EPOCH": EPOCH} | os.environ
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-t", "sdist", "-d", str(out.absolute())]
    subprocess.run(build, cwd=ROOT, env=environment, check=True)
    if SBOM.exists():
        shutil.copy(SBOM, out)
    for name in arms:
        robot = load_robot(name)
        for version in FMI_VERSIONS:
            fitting = [each for each in platforms if each != COMPONENT or version == FMI_3.name]
            build_fmus(robot, out / name / f"fmi{version}", fmi_version=version, platforms=fitting, progress=True)
        scenario = reach_scenario(name)
        write_reference(scenario, out / name / "reference", system_values(scenario, {}))
    files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    sums = (f"{hashlib.sha256((out / name).read_bytes()).hexdigest()}  {name}\n" for name in files)
    (out / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Make a release: wheel, sdist, FMUs, packages, results, checksums.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / f"vdfmu-{__version__}")
    parser.add_argument("--only", metavar="ARM", nargs="+", choices=robot_names(), default=robot_names())
    parser.add_argument("--platform", nargs="+", choices=[*PLATFORMS], default=[*PLATFORMS])
    given = parser.parse_args()
    make(given.out, given.only, given.platform)


if __name__ == "__main__":
    main()
