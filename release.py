"""Make a release: ``make release``. It takes SOURCE_DATE_EPOCH or a fixed date, and twice gives the same bits.

``dist/vdfmu-VERSION`` gets the wheel, the sdist, the bill of materials that ``make sbom`` wrote, the recipe for conda,
and for each arm the FMUs of its units in FMI 2.0 and 3.0 for all platforms, a first motion as SSP 1.0 and 2.0, and
reference results of it. README.md says what each file is. SHA256SUMS has the digest of each: ``sha256sum -c``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.arm.units import shipped_units
from vdfmu.base.cache import one_job
from vdfmu.base.platforms import PLATFORMS, this_platform
from vdfmu.base.standards import FMI_VERSIONS
from vdfmu.base.version import __version__
from vdfmu.study.runs import write_reference
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.replace import unfolded
from vdfmu.system.scenario.values import system_values

ROOT = Path(__file__).parent
SBOM = ROOT / "dist" / "sbom.cdx.json"
SDIST = f"vdfmu-{__version__}.tar.gz"
RECIPE_SOURCE = ("  path: ..\n", f"  path: {SDIST}\n  sha256: DIGEST\n")
"""Source in the recipe of the tree, and in that of a release: its sdist next to it, with the digest."""
EPOCH = "1577836800"
"""Date of the files in archives where SOURCE_DATE_EPOCH says none: 1 January 2020, as of hatchling."""

WHEEL_TAGS = {
    "x86_64-linux": "manylinux_2_17_x86_64", "aarch64-linux": "manylinux_2_17_aarch64", "x86_64-windows": "win_amd64",
    "x86_64-darwin": "macosx_11_0_x86_64", "aarch64-darwin": "macosx_11_0_arm64",
}  # fmt: skip
"""Platforms that can have a wheel with compiled code, to their names in wheels."""
PREBUILT = re.compile("native|kernels|programs|texts|reference|[0-9a-f]{32}.*")
"""Folders of the cache with what is traced and compiled, and the reference results inside FMUs. Others have results of
runs, pages and FMUs."""

README = """\
# vdfmu {version}

Serial manipulators with flexible joints as FMUs, for tools of FMI and SSP. The FMUs need no Python.

| file | what |
| --- | --- |
| `ARM/fmi2.0/UNIT.fmu`, `ARM/fmi3.0/UNIT.fmu` | a unit: FMI 2.0 has scalars, 3.0 arrays if all joints turn |
| `ARM/reference/` | the system of an arm as SSP 1.0 and 2.0, its results, a script that compares yours, a README |
| `vdfmu-{version}-py3-none-any.whl` | the Python package |
| `vdfmu-{version}-py3-none-PLATFORM.whl` | the same, with compiled code of the first run for one platform |
| `constraints.txt` | versions of other packages that it was tested with |
| `vdfmu-{version}.tar.gz`, `recipe.yaml` | all sources, with tests and documentation; the recipe of the conda package |
{bill}| `SHA256SUMS` | the digest of each file: `sha256sum -c SHA256SUMS` |
| `LICENSE` | MIT; an FMU has its own, with the compiler's, in `documentation/licenses` |

## To import an FMU

Use FMI 2.0, unless your tool supports the arrays of FMI 3.0. One file has the libraries of all platforms:
{platforms}. Units are SI, angles in rad.
An FMU is a zip file: in it are `documentation/index.html`, equations and variables; `sources/`, C for other platforms;
`extra/org.fmi-standard.fmi-ls-ref/`, an experiment and its results.

Plant.fmu is for co-simulation and model exchange; its input `tau` is the torque of the motors. Start values are those
of the arm's first motion: Trajectory, Feedforward, PDController and Plant move the arm as they are. Connect outputs to
inputs of the same name, with a step of 1 ms. The packages in `reference/` are that system; its tables of results are
what your tool should give.

| unit | what |
| --- | --- |
{units}

| arm | joints | what |
| --- | ---: | --- |
{arms}
"""


def problems(final: bool) -> list[str]:
    """Return what does not fit together: version, changelog, and of a final release date and commit."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (.*)", changelog, re.MULTILINE)
    heading = newest[1] if newest else "none"
    found: list[str] = []
    if not heading.startswith(f"[{__version__}] - "):
        found.append(f"CHANGELOG.md: expected [{__version__}] as its newest version, as vdfmu has it, got {heading}.")
    if not final:
        return found
    date = heading.rpartition(" - ")[2]
    if not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        found.append(f"CHANGELOG.md: expected the date of the release, such as 2027-01-31, got {date}.")
    elif f"\ndate-released: {date}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        found.append(f"CITATION.cff: expected date-released: {date}, as the changelog has it.")
    if changed := _git("status", "--porcelain"):
        found.append(f"git: expected a commit, got changed or further files: {', '.join(changed)}.")
    if f"v{__version__}" not in _git("tag", "--points-at", "HEAD"):
        found.append(f"git: expected the tag v{__version__} at this commit.")
    return found


def _git(*arguments: str) -> list[str]:
    """Return the lines that git prints."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.split("\n")[:-1]


def make(out: Path, arms: Sequence[str], platforms: Sequence[str]) -> None:
    """Write a release into a folder, which is emptied first."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    environment = {"SOURCE_DATE_EPOCH": EPOCH} | os.environ
    _build(out, environment, "wheel", "sdist")
    _write_platform_wheel(out, environment)
    from vdfmu.extras.robots.reach import reach_scenario  # the core has tests of a release too

    for name in arms:
        with one_job():
            _write_arm(unfolded(reach_scenario(name)), out / name, platforms)
    _write_texts(out, arms, platforms)
    files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    sums = (f"{sha256((out / name).read_bytes()).hexdigest()}  {name}\n" for name in files)
    (out / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")


def _build(out: Path, environment: Mapping[str, str], *kinds: str) -> None:
    """Let hatchling write archives of some kinds."""
    asked = [word for kind in kinds for word in ("-t", kind)]
    command = [sys.executable, "-m", "hatchling", "build", *asked, "-d", str(out.absolute())]
    subprocess.run(command, cwd=ROOT, env=dict(environment), check=True)


def _write_platform_wheel(out: Path, environment: Mapping[str, str]) -> None:
    """Write the wheel for this platform: with what ``vdfmu run tracking`` compiles, so that its user need not."""
    with tempfile.TemporaryDirectory() as folder:
        cache, packed = Path(folder, "cache"), Path(folder, "prebuilt")
        packed.mkdir()
        run = [sys.executable, "-m", "vdfmu.cli", "run", "tracking", "--quiet", "--out", str(Path(folder, "run"))]
        subprocess.run(run, cwd=ROOT, env={**environment, "VDFMU_CACHE_DIR": str(cache)}, check=True)
        for kind in (each for each in sorted(cache.iterdir()) if PREBUILT.fullmatch(each.name)):
            with tarfile.open(packed / f"{kind.name}.tar.xz", "w:xz", preset=9) as archive:
                for entry in sorted(kind.iterdir()):
                    member = tarfile.TarInfo(entry.name)  # without the times and the user of this machine
                    member.size = entry.stat().st_size
                    with entry.open("rb") as file:
                        archive.addfile(member, file)
        added = {"VDFMU_PREBUILT": str(packed), "VDFMU_WHEEL_TAG": WHEEL_TAGS[this_platform()]}
        _build(out, {**environment, **added}, "wheel")


def _write_arm(scenario: Scenario, folder: Path, platforms: Sequence[str]) -> None:
    """Write the FMUs of an arm with the values of a motion, the packages that move it, and what comes of it."""
    values = system_values(scenario, {})
    for version in FMI_VERSIONS:
        build_fmus(
            scenario.robot, folder / f"fmi{version}", parameters=values, fmi_version=version, platforms=platforms,
            progress=True,
        )  # fmt: skip
    write_reference(scenario, folder / "reference", values)


def _write_texts(out: Path, arms: Sequence[str], platforms: Sequence[str]) -> None:
    """Write what is of all arms: README, licence, recipe, and the bill of materials if there is one."""
    robots = [load_robot(name) for name in arms]
    readme = README.format(
        version=__version__,
        bill="| `sbom.cdx.json` | what is installed with the package, as CycloneDX |\n" if SBOM.exists() else "",
        platforms=", ".join(f"`{name}`" for name in platforms),
        units="\n".join(f"| {unit.__name__} | {unit.description()} |" for unit in shipped_units().values()),
        arms="\n".join(f"| {robot.name} | {robot.n} | {robot.description} |" for robot in robots),
    )
    (out / "README.md").write_text(readme, encoding="utf-8")
    for name in ("LICENSE", "constraints.txt"):
        shutil.copyfile(ROOT / name, out / name)
    digest = sha256((out / SDIST).read_bytes()).hexdigest()
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    (out / "recipe.yaml").write_text(recipe.replace(*RECIPE_SOURCE).replace("DIGEST", digest), encoding="utf-8")
    if SBOM.exists():
        bill = json.loads(SBOM.read_bytes())
        bill["metadata"]["component"]["version"] = __version__
        (out / SBOM.name).write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Make a release: wheel, sdist, FMUs, packages, results, checksums.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / f"vdfmu-{__version__}")
    parser.add_argument("--only", metavar="ARM", nargs="+", choices=robot_names(), default=robot_names())
    parser.add_argument("--platform", nargs="+", choices=[*PLATFORMS], default=[*PLATFORMS])
    parser.add_argument("--final", action="store_true", help="refuse without date in the changelog, tag and commit")
    given = parser.parse_args()
    if found := problems(given.final):
        parser.exit(1, "\n".join(found) + "\n")
    make(given.out, given.only, given.platform)


if __name__ == "__main__":
    main()
