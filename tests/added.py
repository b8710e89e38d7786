"""Packages of others, as an installer leaves them: a folder with what it writes beside the modules of a package."""

from collections.abc import Mapping
from pathlib import Path


def installed(folder: Path, name: str, points: Mapping[str, Mapping[str, str]]) -> None:
    """Write what an installer writes of a package: its entry points, by group."""
    about = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    groups = (f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in each.items())
              for group, each in points.items())  # fmt: skip
    (about / "entry_points.txt").write_text("\n".join(groups))
