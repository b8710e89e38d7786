"""Runs the official checker of eFMUs, `python check.py X.fmu`, in an empty folder.

``efmi-compliancechecker.zip`` is the folder ``complianceChecker`` of github.com/modelica/efmi-compliancechecker at
commit bbe0b92e, unchanged, with its licence, BSD of three clauses. It was written for lark 0.12: later versions differ
in a default and in where a tree says its line. And it uses a mode of `open` that Python 3.11 no longer has.
"""

import builtins
import functools
import gc
import logging
import sys
from pathlib import Path
from typing import Any

import colorama
import lark

_open = builtins.open


def _opened(file: Any, mode: str = "r", *further: Any, **options: Any) -> Any:
    return _open(file, mode.replace("U", ""), *further, **options)


if __name__ == "__main__":
    gc.set_threshold(100_000, 50, 100)  # a parser keeps millions of objects: collections took a third of its time
    builtins.open = _opened
    colorama.init = lambda: None  # leaves findings red, of which they are known
    lark.Lark = functools.partial(lark.Lark, maybe_placeholders=False)
    setattr(lark.Tree, "line", property(lambda tree: tree.meta.line))  # noqa: B010
    sys.path.insert(0, str(Path(__file__).with_name("efmi-compliancechecker.zip")))
    import ComplianceChecker  # pyright: ignore[reportMissingImports]

    logging.disable()
    sys.exit(ComplianceChecker.read_model_container(sys.argv[1]))
