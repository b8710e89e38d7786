"""Files and functions of the package that a command enters: ``python -m benchmarks.path [run tracking]``.

A second run in a process is measured, so that nothing is built. Class bodies and what runs on import do not count.
"""

from __future__ import annotations

import sys
import tempfile
from collections import defaultdict
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import vdfmu
from vdfmu.cli import main

ROOT = Path(vdfmu.__file__).parent


def entered(words: list[str]) -> dict[str, set[str]]:
    """Return the files that a command enters, relative to the package, with the names of their functions."""
    codes = set[CodeType]()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_flags & CO_OPTIMIZED:
            codes.add(frame.f_code)

    sys.argv = ["vdfmu", *words]
    sys.setprofile(note)
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    finally:
        sys.setprofile(None)
    files = defaultdict[str, set[str]](set)
    for code in codes:
        if Path(code.co_filename).is_relative_to(ROOT) and not code.co_name.startswith("<"):
            files[Path(code.co_filename).relative_to(ROOT).as_posix()].add(code.co_qualname)
    return files


if __name__ == "__main__":
    command = sys.argv[1:] or ["run", "tracking"]
    with tempfile.TemporaryDirectory() as folder:
        words = [*command, "--quiet", "--out", folder]
        entered(words)  # which builds what is missing
        files = entered(words)
    for file, names in sorted(files.items()):
        print(f"{file:44}{', '.join(sorted(names)[:4])}{', ...' if len(names) > 4 else ''}")
    print(f"{len(files)} files, {sum(map(len, files.values()))} functions")
