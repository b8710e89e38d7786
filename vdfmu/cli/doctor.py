"""``vdfmu doctor``: installed packages, effects of missing packages, the cache."""

from __future__ import annotations

import os
import platform
import sys

from vdfmu.base.standards import WITHOUT_NATIVE

WITHOUT = {
    "native": WITHOUT_NATIVE,
    "parquet": "results are CSV, three times the size",
    "matlab": "no logs from MATLAB files of version 7.3; files of version 5 need nothing",
    "sweep": "no parameter studies (vdfmu sweep) and no tuning",
    "federate": "a system runs in one process only",
    "notebook": "no jupyter lab, no to_pandas(), no to_xarray(), no bars in a notebook",
    "motion": "no motions in the shortest time (kind fastest)",
    "view": "no vdfmu view and no --live",
    "learn": "no environments for reinforcement learning",
    "robots": "no robots from MJCF; those from URDF need nothing",
}
"""Extra of the package to the effect of its absence."""


def doctor() -> None:
    """Print the installed packages and the effects of missing packages."""
    from vdfmu.base.errors import FmuError
    from vdfmu.base.platforms import compiler, native_available, this_platform
    from vdfmu.base.version import __version__
    from vdfmu.cli.cache import say_cache
    from vdfmu.cli.extras import installed
    from vdfmu.cli.terminal import say

    try:
        here = this_platform()
    except FmuError as error:
        here = f"{platform.system()} on {platform.machine()}: {error}"
    say(f"vdfmu {__version__}, Python {platform.python_version()} ({sys.executable})")
    say(f"Machine  {here}, {os.cpu_count()} processors")
    packages, missing = installed("")
    say(f"Needs    {', '.join(packages)}")
    if native_available():
        c_compiler = compiler(here)
        platforms = "this and all other platforms" if c_compiler.is_zig else "this platform; the others need ziglang"
        say(f"Compiler {c_compiler.name}: native FMUs for {platforms}")
    own_only = {"native": "native FMUs for this platform only, no engine batch"} if native_available() else {}
    for extra, without in (WITHOUT | own_only).items():
        there, lacks = installed(extra)
        if not there + lacks:  # of an installation before this version
            lacks = ["it is"]
        if lacks:
            say(f"Extra    {extra}: {', '.join(lacks)} not installed: {without}. pip install 'vdfmu[{extra}]'")
        else:
            say(f"Extra    {extra}: {', '.join(there)}")
    say_cache()
    if missing:
        say(f"error: {', '.join(missing)} not installed, without which nothing runs: install vdfmu again")
        raise SystemExit(1)
