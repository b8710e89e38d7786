"""``vdfmu cache`` and ``vdfmu cache clear``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vdfmu.cli.app import App
from vdfmu.cli.terminal import say

if TYPE_CHECKING:
    from vdfmu.base.cache import CachedFile


def say_cache() -> None:
    """Print folder, entries and size."""
    from vdfmu.base.cache import COMPILER, cache_folder, entries, limit

    folder = cache_folder()
    found = entries(folder)
    say(f"Folder   {folder}")
    say(f"Entries  {len(found)}")
    say(f"Size     {_size(found)}, at most {limit() / 2**20:g} MB")
    say(f"What the compiler keeps for itself, in {folder / COMPILER}, is not counted.")


app = App("cache", default=say_cache, help="Show the cache of what was built, or clear it.", example="vdfmu cache")


@app.command("clear", example="vdfmu cache clear")
def clear_cache() -> None:
    """Remove all entries; what the compiler keeps for itself stays."""
    from vdfmu.base.cache import cache_folder, clear

    removed = clear(cache_folder())
    say(f"Removed {len(removed)} entries, {_size(removed)}.")


def _size(found: list[CachedFile]) -> str:
    return f"{sum(entry.size for entry in found) / 2**20:.1f} MB"
