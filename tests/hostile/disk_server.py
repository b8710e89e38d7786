"""Starts commands of vdfmu whose modules are imported once: each runs in a fork of this process, with `disk.c` in it.

It gets a line of JSON for each command, and answers with lines: the number of the process, then its exit code.
"""

import importlib
import json
import os
import pkgutil
import sys

import vdfmu


def _imported() -> None:
    for module in pkgutil.walk_packages(vdfmu.__path__, "vdfmu."):
        if not module.name.endswith("__main__") and ".fmu.python" not in module.name:
            importlib.import_module(module.name)
    import matplotlib.pyplot  # noqa: F401
    import pyarrow.parquet  # noqa: F401


def _asked() -> None:
    """Return in the fork of each command; end with the input."""
    while line := sys.stdin.readline():
        asked = json.loads(line)
        number = os.fork()
        if number == 0:
            os.setsid()
            said = os.open(asked["said"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            null = os.open(os.devnull, os.O_RDONLY)
            for descriptor, target in ((null, 0), (said, 1), (said, 2)):
                os.dup2(descriptor, target)
            os.chdir(asked["folder"])
            os.environ.update(asked["environment"])
            sys.argv = ["vdfmu", *asked["words"]]
            return
        print(number, flush=True)
        _, status = os.waitpid(number, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)
    sys.exit(0)


if __name__ == "__main__":
    _imported()
    _asked()
    from vdfmu.cli import main

    main()
