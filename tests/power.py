"""A disk that loses power: names and contents that were not synced may be missing after it.

It records what a program does to the files below a folder, and gives the states in which a power failure may leave
them. As on journaling file systems, changes of names reach the disk in their order, all at the latest by fsync of their
folder. The content of a file reaches it by fsync of the file; without, the file is empty.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


class Power:
    """Records the changes of names and contents below a folder."""

    def __init__(self, root: Path, patch: pytest.MonkeyPatch) -> None:
        self._root = root
        self._inodes: dict[str, int] = {}
        self._events: list[tuple[Any, ...]] = []
        self._opened = 0
        names = {"open": os.open, "replace": os.replace, "rename": os.rename, "unlink": os.unlink, "mkdir": os.mkdir,
                 "rmdir": os.rmdir, "fsync": os.fsync}  # fmt: skip

        def recorded(call: str) -> Any:
            function = names[call]

            def record(*arguments: Any, **more: Any) -> Any:
                new = call == "open" and arguments[1] & os.O_CREAT and not os.path.exists(arguments[0])
                result = function(*arguments, **more)
                if call == "fsync":
                    self._synced(arguments[0])
                elif call != "open" or new:
                    self._named(
                        call, *map(os.fspath, arguments[:2] if call in ("replace", "rename") else arguments[:1])
                    )
                return result

            return record

        for call in names:
            patch.setattr(os, call, recorded(call))

    def done(self, promise: Any) -> None:
        """Note that the program has promised something: it holds in all states from here on."""
        self._events.append(("done", promise))

    def _place(self, path: str) -> str | None:
        path = os.path.abspath(path)
        return os.path.relpath(path, self._root) if Path(path).is_relative_to(self._root) else None

    def _named(self, call: str, *paths: str) -> None:
        places = [self._place(path) for path in paths]
        if None not in places:
            if call == "open":
                self._opened += 1
                self._inodes[str(places[0])] = self._opened
            elif call in ("replace", "rename"):
                self._inodes[str(places[1])] = self._inodes.pop(str(places[0]), 0)
            inode = self._inodes.get(str(places[-1]), 0)
            self._events.append((call, *places, inode) if call in ("open", "replace", "rename") else (call, *places))

    def _synced(self, handle: int) -> None:
        path = os.readlink(f"/proc/self/fd/{handle}")
        place = self._place(path)
        if place is not None and os.path.isdir(path):
            self._events.append(("sync folder", place))
        elif place is not None:
            self._events.append(("sync", self._inodes[place], Path(path).read_bytes()))

    def states(self, target: Path) -> Iterator[tuple[list[Any], Path]]:
        """Yield for each possible state what was promised before, and a new folder below `target` in this state."""
        made: set[Any] = set()
        number = 0
        for end in range(len(self._events) + 1):
            names: dict[str, int | None] = {".": None}
            contents: dict[int, bytes] = {}
            waiting: list[tuple[Any, ...]] = []
            promised: list[Any] = []
            for event in self._events[:end]:
                match event:
                    case ("done", promise):
                        promised.append(promise)
                    case ("sync", inode, content):
                        contents[inode] = content
                    case ("sync folder", place):
                        for change in [each for each in waiting if place in _folders(each)]:
                            _change(names, change)
                            waiting.remove(change)
                    case _:
                        waiting.append(event)
            for count in range(len(waiting) + 1):
                after = dict(names)
                for change in waiting[:count]:
                    _change(after, change)
                state = (len(promised), frozenset(after.items()), frozenset(contents.items()))
                if state not in made:
                    made.add(state)
                    number += 1
                    folder = target / str(number)
                    _write(folder, after, contents)
                    yield promised, folder


def _folders(change: tuple[Any, ...]) -> set[str]:
    """Return the folders whose names an operation changes; fsync of one of them is enough."""
    return {os.path.dirname(place) or "." for place in change[1:] if isinstance(place, str)}


def _change(names: dict[str, int | None], change: tuple[Any, ...]) -> None:
    """Change the names by an operation; None is a folder."""
    match change:
        case ("open", place, inode):
            names[place] = inode
        case ("mkdir", place):
            names[place] = None
        case ("replace" | "rename", before, place, inode):
            names.pop(before, None)
            names[place] = inode
        case (_, place):
            names.pop(place, None)


def _write(folder: Path, names: dict[str, int | None], contents: dict[int, bytes]) -> None:
    """Write the files whose folders are there, too."""
    for place, inode in sorted(names.items(), key=lambda item: item[0].count("/") + (item[0] != ".")):
        path = folder / place
        if place != "." and not path.parent.is_dir():
            continue
        if inode is None:
            path.mkdir()
        else:
            path.write_bytes(contents.get(inode, b""))
