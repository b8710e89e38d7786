"""Plugins of other packages: entry points of the groups ``vdfmu.units``, ``.robots``, ``.logs`` and so on.

Reading them takes some 10 ms, so they are read only for names that are not shipped, and to list all names.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from vdfmu.base.errors import UsageError
from vdfmu.base.progress import warn_once
from vdfmu.base.text import kind_text
from vdfmu.base.trust import before_code, is_reading_only

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_T = TypeVar("_T")


@dataclass(frozen=True)
class Plugins:
    """A group of entry points."""

    group: str
    """Name after ``vdfmu.``."""
    noun: str
    """Noun of a plugin in messages."""
    expected: str
    """Object that an entry point must have, in messages."""
    fits: Callable[[Any], bool]
    """Whether an object is a valid plugin."""

    def get(self, name: str) -> Any:
        """Return the plugin of this name, or None. UsageError if it is invalid or if several packages add it."""
        points = _points(self.group).get(name, [])
        if len(points) > 1:
            raise UsageError(
                f"{self.noun} {name!r}: expected one package that adds it, got {' and '.join(map(_package, points))}. "
                "Uninstall one of them."
            )
        return self._load(points[0]) if points else None

    def all(self, shipped: Container[str]) -> dict[str, Any]:
        """Return valid plugins by name. Plugins that are invalid or have a shipped name are ignored with a warning.

        Empty within `vdfmu.base.trust.reading_only`, because a plugin is only known after its code has run.
        """
        valid: dict[str, Any] = {}
        if is_reading_only():
            return valid
        for name, points in sorted(_points(self.group).items()):
            if name in shipped:
                packages = " and ".join(map(_package, points))
                warn_once(f"{self.noun} {name!r} of {packages} is ignored: vdfmu itself has one of this name.")
                continue
            try:
                valid[name] = self.get(name)
            except UsageError as error:
                warn_once(f"ignored: {error}")
        return valid

    def _load(self, point: EntryPoint) -> Any:
        before_code(_package(point))
        try:
            plugin = point.load()
            if self.fits(plugin):
                return plugin
            got = f"{point.value}, which is {type(plugin).__name__}"
        except (Exception, SystemExit) as error:  # foreign code may raise anything
            got = f"{point.value}: {kind_text(error)}"
        raise UsageError(
            f"{self.noun} {point.name!r} of {_package(point)} cannot be used: expected {self.expected}, got {got}. "
            "Fix or uninstall that package."
        )


def added(group: str, name: str) -> bool:
    """Whether a package adds a name to a group, even if invalid. Loads nothing."""
    return name in _points(group)


class PluginTable(dict[str, _T]):
    """Table of shipped rows, to which ``in`` and ``[]`` add plugins. Iteration covers rows so far; `names` has all."""

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
        plugin = self._plugins.get(name) if key == self._prefix + name and name else None
        if plugin is None:
            raise KeyError(key)
        self[key] = plugin
        return plugin

    def names(self, unless: object = None) -> list[str]:
        """Return all names. If `unless` is a shipped name, plugins are not read, and their names may be missing."""
        if not isinstance(unless, str) or unless not in self._shipped:
            shipped = {key.removeprefix(self._prefix) for key in self._shipped}
            self.update({self._prefix + name: row for name, row in self._plugins.all(shipped).items()})
        return list(self)


@cache
def _points(group: str) -> dict[str, list[EntryPoint]]:
    from importlib.metadata import entry_points

    points: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=f"vdfmu.{group}"):
        points.setdefault(point.name, []).append(point)
    return points


def _package(point: EntryPoint) -> str:
    return f"the package {point.dist.name} {point.dist.version}" if point.dist else f"a package with {point.value}"
