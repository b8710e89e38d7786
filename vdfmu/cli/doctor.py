"""``vdfmu doctor``: installed packages, effects of missing packages, the cache."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterable
from typing import Annotated

from vdfmu.base.option import Option
from vdfmu.base.standards import WITHOUT_NATIVE
from vdfmu.cli.terminal import say

WITHOUT = {
    "native": WITHOUT_NATIVE,
    "parquet": "results are CSV, three times the size",
    "matlab": "no logs from MATLAB files of version 7.3; files of version 5 need nothing",
    "sweep": "no parameter studies (vdfmu sweep) and no tuning",
    "notebook": "no jupyter lab, no to_pandas(), no to_xarray(), no bars in a notebook",
    "motion": "no motions in the shortest time (kind fastest)",
    "view": "no meshes on pages of robots (vdfmu robot show --page)",
    "learn": "no environments for reinforcement learning",
    "robots": "no robots from MJCF; those from URDF need nothing",
}
"""Extra of the package to the effect of its absence."""


def doctor(
    cache: Annotated[bool, Option("Print only the cache of built FMUs.")] = False,
    clear_cache: Annotated[bool, Option("Empty the cache; the compiler's cache stays.")] = False,
) -> None:
    """Print installed and missing packages, and the state of the cache."""
    if clear_cache:
        return _clear_cache()
    if cache:
        return _say_cache()
    from vdfmu.base.errors import FmuError
    from vdfmu.base.platforms import compiler, native_available, this_platform
    from vdfmu.base.version import __version__
    from vdfmu.cli.extras import installed

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
        if not there + lacks:  # from an installation before this version
            lacks = ["it is"]
        if lacks:
            say(f"Extra    {extra}: {', '.join(lacks)} not installed: {without}. pip install 'vdfmu[{extra}]'")
        else:
            say(f"Extra    {extra}: {', '.join(there)}")
    _say_cache()
    if missing:
        say(f"error: {', '.join(missing)} not installed, without which nothing runs: install vdfmu again")
        raise SystemExit(1)


def _say_cache() -> None:
    """Print folder, entries and size."""
    from vdfmu.base.cache import COMPILER, cache_folder, entries, limit

    folder = cache_folder()
    listed = entries(folder)
    say(f"Cache    {folder}")
    say(f"Entries  {len(listed)}")
    say(f"Size     {_size(entry.size for entry in listed)}, at most {limit() / 2**20:g} MB")
    say(f"The cache of the compiler, {folder / COMPILER}, is not counted.")


def _clear_cache() -> None:
    from vdfmu.base.cache import cache_folder, entries

    removed = [entry.size for entry in entries(cache_folder()) if entry.remove()]
    say(f"Removed {len(removed)} entries, {_size(removed)}.")


def _size(sizes: Iterable[int]) -> str:
    return f"{sum(sizes) / 2**20:.1f} MB"
