"""Packages of others, as an installer leaves them: a folder with what it writes beside the modules of a package."""

import os
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

from tests.docs.pages import ROOT, read_blocks

PAGE = ROOT / "docs" / "plugins.md"


def installed(folder: Path, name: str, points: Mapping[str, Mapping[str, str]]) -> None:
    """Write what an installer writes of a package: its entry points, by group."""
    about = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    groups = (f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in each.items())
              for group, each in points.items())  # fmt: skip
    (about / "entry_points.txt").write_text("\n".join(groups))


def write_acme(folder: Path) -> Path:
    """Write the package of ``docs/plugins.md``, installed; return its folder."""
    files = {options.split('"')[1]: body for _, options, body, _, _ in read_blocks(PAGE) if "title=" in options}
    project = tomllib.loads(files.pop("pyproject.toml"))["project"]
    for name, body in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(body)
    robot = (ROOT / "models" / "robots" / "planar_2dof.toml").read_text()
    (folder / "acme_arms" / "acme_2.toml").write_text(robot.replace('"planar_2dof"', '"acme_2"'))
    installed(folder, project["name"], project["entry-points"])
    return folder


def command(folder: Path, acme: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command with the package `acme`."""
    path = os.pathsep.join([str(ROOT), str(acme)])
    return subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", *words], cwd=folder, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": path, "COLUMNS": "200"},
    )  # fmt: skip
