"""What is installed: versions that were tested together, named without a place to get them from."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_constraint_is_a_name_and_a_version() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:]
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9.-]*==[0-9][0-9a-z.]*", line) for line in lines)
    assert lines == sorted(lines)


def test_every_dependency_and_the_tools_of_the_supply_are_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *sum(project["optional-dependencies"].values(), []),
        "cyclonedx-bom",
        "pip-audit",
    ]
    names = {re.split(r"[\[<>=; ]", entry)[0].lower().replace("_", "-") for entry in wanted} - {"vdfmu"}
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert names <= {line.partition("==")[0] for line in lines}


def test_the_install_without_make_takes_the_tested_versions() -> None:
    for page in ("README.md", "docs/index.md", "docs/native.md"):
        lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
        installs = [line for line in lines if re.match(r"(\.venv/bin/)?pip install", line)]
        assert installs
        assert all("-c constraints.txt" in line for line in installs)
