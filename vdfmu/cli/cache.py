"""``vdfmu cache`` and ``vdfmu cache clear``."""

from __future__ import annotations

from collections.abc import Iterable

from vdfmu.cli.app import App
from vdfmu.cli.terminal import say


def say_cache() -> None:
    """Print folder, entries and size."""
    from vdfmu.base.cache import COMPILER, cache_folder, entries, limit

    folder = cache_folder()
    listed = entries(folder)
    say(f"Folder   {folder}")
    say(f"Entries  {len(listed)}")
    say(f"Size     {_size(entry.size for entry in listed)}, at most {limit() / 2**20:g} MB")
    say(f"The cache of the compiler, {folder / COMPILER}, is not counted.")


app = App("cache", default=say_cache, help="Show the cache of built FMUs, or clear it.", example="vdfmu cache")


@app.command("clear", example="vdfmu cache clear")
def clear_cache() -> None:
    """Remove all entries; the cache of the compiler stays."""
    from vdfmu.base.cache import cache_folder, entries

    removed = [entry.size for entry in entries(cache_folder()) if entry.remove()]
    say(f"Removed {len(removed)} entries, {_size(removed)}.")


def _size(sizes: Iterable[int]) -> str:
    return f"{sum(sizes) / 2**20:.1f} MB"
