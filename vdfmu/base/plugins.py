"""What other packages add, by entry points of the groups ``vdfmu.units``, ``.robots``, ``.logs`` and so on.

Reading them takes some 10 ms. Only a name that is not shipped, and a list of all names, does.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from vdfmu.base.errors import UsageError
from vdfmu.base.progress import warn_once
from vdfmu.base.text import kind_text

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_T = TypeVar("_T")


@dataclass(frozen=True)
class Plugins:
    """A group of entry points."""

    group: str
    """Its name behind ``vdfmu.``."""
    one: str
    """Name of a member in messages."""
    expected: str
    """What its entry points name, in messages."""
    fits: Callable[[Any], bool]
    """Whether an object is one."""

    def get(self, name: str) -> Any:
        """Return the object of a name, None if no package adds one.

        Raises
        ------
        UsageError
            If it cannot be used, or several packages add one of this name; with the packages.
        """
        points = _points(self.group).get(name, [])
        if len(points) > 1:
            raise UsageError(
                f"{self.one} {name!r}: expected one package that adds it, got {' and '.join(map(_package, points))}. "
                "Uninstall one of them."
            )
        return self._load(points[0]) if points else None

    def all(self, shipped: Container[str]) -> dict[str, Any]:
        """Return what can be used, by name, without names that are shipped; a warning says what is left out."""
        found: dict[str, Any] = {}
        for name, points in sorted(_points(self.group).items()):
            if name in shipped:
                packages = " and ".join(map(_package, points))
                warn_once(f"{self.one} {name!r} of {packages} is left out: vdfmu itself has one of this name.")
                continue
            try:
                found[name] = self.get(name)
            except UsageError as error:
                warn_once(f"left out: {error}")
        return found

    def _load(self, point: EntryPoint) -> Any:
        try:
            found = point.load()
            got = f"{point.value}, which is {type(found).__name__}"
            good = self.fits(found)
        except (Exception, SystemExit) as error:  # whatever code of others raises
            got, good, found = f"{point.value}: {kind_text(error)}", False, None
        if good:
            return found
        raise UsageError(
            f"{self.one} {point.name!r} of {_package(point)} cannot be used: expected {self.expected}, got {got}. "
            "Mend or uninstall that package."
        )


def added(group: str, name: str) -> bool:
    """Whether a package adds something of a name to a group, even if it cannot be used; nothing is loaded."""
    return name in _points(group)


class PluginTable(dict[str, _T]):
    """A table whose rows are shipped, or added by other packages: these are found by ``in`` and by ``[]``.

    Iteration gives the shipped rows and those that were used; `names` gives all.
    """

    def __init__(self, plugins: Plugins, shipped: Mapping[str, _T], prefix: str = "") -> None:
        super().__init__(shipped)
        self._plugins, self._prefix, self._shipped = plugins, prefix, {*shipped}

    def __contains__(self, key: object) -> bool:
        if super().__contains__(key):
            return True
        try:
            return isinstance(key, str) and self[key] is not None
        except KeyError:
            return False

    def __missing__(self, key: str) -> _T:
        name = key.removeprefix(self._prefix)
        found = self._plugins.get(name) if key == self._prefix + name and name else None
        if found is None:
            raise KeyError(key)
        self[key] = found
        return found

    def names(self, unless: object = None) -> list[str]:
        """Return all names; where `unless` is one that is shipped, those are enough and no other is looked for."""
        if not isinstance(unless, str) or unless not in self._shipped:
            own = {key.removeprefix(self._prefix) for key in self._shipped}
            self.update({self._prefix + name: row for name, row in self._plugins.all(own).items()})
        return list(self)


@cache
def _points(group: str) -> dict[str, list[EntryPoint]]:
    from importlib.metadata import entry_points

    found: dict[str, list[EntryPoint]] = {}
    for each in entry_points(group=f"vdfmu.{group}"):
        found.setdefault(each.name, []).append(each)
    return found


def _package(point: EntryPoint) -> str:
    return f"the package {point.dist.name} {point.dist.version}" if point.dist else f"a package with {point.value}"
