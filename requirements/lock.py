"""Write ``constraints.txt`` and the files beside this one: all versions that make installs, with hashes of their files.

``make lock`` keeps what ``constraints.txt`` has where it still fits; ``make lock LOCK=--upgrade`` takes the newest.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
PROJECT = ROOT / "pyproject.toml"
CONSTRAINTS = ROOT / "constraints.txt"
FILES = {
    "base": ((), ()),
    "native": (("--extra=native",), ("base",)),
    "docs": (("--extra=docs",), ("base",)),
    "dev": (("--extra=dev",), ("base",)),
    "test": (("--extra=test",), ("docs", "native")),
    "supply": (("--group=supply",), ()),
}
"""Name of a file to the options that choose its packages, and to the files that it includes."""


def compiled(*options: str, build: bool = True) -> str:
    """Return the packages of the project for every platform, with those that build it unless `build` is False."""
    with open(PROJECT, "rb") as file:
        needed = tomllib.load(file)["build-system"]["requires"]
    command = [
        Path(sys.executable).with_name("uv"), "pip", "compile", "--quiet", "--universal", "--python-version=3.11",
        "--fork-strategy=fewest", "--no-header", "--no-annotate", *options, *(["-"] if build else []),
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, input="\n".join(needed), stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


def blocks(text: str) -> list[str]:
    """Split a file into packages, each with its hashes."""
    return re.split(r"\n(?=\S)", text.strip())


def main() -> None:
    """Choose the versions, then write them with their hashes."""
    compiled("pyproject.toml", "--all-extras", "--group=supply", f"--output-file={CONSTRAINTS}", *sys.argv[1:])
    pins = sorted(line.partition(" ")[0] for line in CONSTRAINTS.read_text(encoding="utf-8").splitlines())
    CONSTRAINTS.write_text(
        "\n".join(["# Versions tested together. Written by: make lock", *pins, ""]), encoding="utf-8"
    )
    written: dict[str, list[str]] = {}
    for name, (options, included) in FILES.items():
        source = () if name == "supply" else ("pyproject.toml",)
        text = compiled(*source, *options, "--generate-hashes", f"--constraints={CONSTRAINTS}", build=bool(source))
        known = {block for other in included for block in written[other]}
        head = ["# Written by: make lock", *(f"-r {other}.txt" for other in included)]
        own = [block for block in blocks(text) if block not in known]
        (HERE / f"{name}.txt").write_text("\n".join([*head, *own, ""]), encoding="utf-8")
        written[name] = [*known, *own]


if __name__ == "__main__":
    main()
