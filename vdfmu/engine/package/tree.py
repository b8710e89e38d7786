"""The elements of an SSD as a tree of `Node`."""

from __future__ import annotations

import posixpath
from typing import Any
from urllib.parse import urlsplit

from vdfmu.base.errors import SspError
from vdfmu.engine.package import archive
from vdfmu.engine.package.archive import resolve
from vdfmu.engine.package.elements import Node, Scope, read_connectors, read_step
from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.engine.rules import Finding, breach, finding

FMU_TYPE = "application/x-fmu-sharedlibrary"


class TreeReader:
    """Turns the XML of systems and components into `Node` objects, and collects problems.

    A system over ``ELEMENT_LIMIT`` or ``DEPTH_LIMIT`` raises SspError.
    """

    def __init__(self, scope: Scope) -> None:
        self.problems: list[Finding] = []
        self._scope = scope
        self._count = 0

    def _fault(self, rule: str, text: str, at: Any) -> None:
        self.problems.append(finding(rule, f"{self._scope.label}: {text}", at))

    def system(self, element: Any, path: tuple[str, ...] = ()) -> Node:
        """Read a system with everything below it."""
        label = self._scope.label
        if len(path) > archive.DEPTH_LIMIT:
            text = f"{label}: {'.'.join(path[:3])}...: systems are nested deeper than {archive.DEPTH_LIMIT}; "
            raise breach("SSP016", f"{text}that is the limit (DEPTH_LIMIT). Merge some of them", element)
        node = Node(path, "system", read_connectors(element), element)
        for child in element.iterfind("ssd:Elements/*", NAMESPACES):
            self._count += 1
            if self._count > archive.ELEMENT_LIMIT:
                text = f"{label}: the system has more than {archive.ELEMENT_LIMIT} elements; "
                raise breach("SSP016", f"{text}that is the limit (ELEMENT_LIMIT). Split the system", child)
            name = child.get("name")
            if name in node.children:
                self._fault("SSP017", f"two elements are named {node.dotted(name)!r}", child)
            kind = child.tag.rsplit("}", 1)[1]
            if kind == "System":
                node.children[name] = self.system(child, (*path, name))
            elif kind == "Component":
                node.children[name] = self._component(child, (*path, name))
            else:
                text = f"{node.dotted(name)!r} refers to a signal dictionary, which is not read; "
                self._fault("SSP020", f"{text}connect the components themselves", child)
        return node

    def _component(self, element: Any, path: tuple[str, ...]) -> Node:
        """Read a component, an FMU."""
        node = Node(path, "component", read_connectors(element), element)
        where, source = f"component {node.label!r}", element.get("source") or ""
        kind, suffix = element.get("type", FMU_TYPE), posixpath.splitext(urlsplit(source).path)[1].lower()
        if not source:
            self._fault("SSP013", f"{where}: has no source to run; name an FMU", element)
        elif source.startswith("#") or kind != FMU_TYPE or suffix in (".ssp", ".ssd"):
            text = f"{where}: {source!r} of type {kind!r} is not an FMU ({FMU_TYPE}); a system in another file, or by "
            self._fault("SSP014", f"{text}its id, is not read. Write it into this SSD, as ssd:System", element)
        else:
            where = f"{self._scope.label}: {where}"
            try:
                member = resolve(source, where, element)
                if member in self._scope.archive:
                    node.source = member
                else:
                    raise breach("SSP011", f"{where}: the package has no {member!r}", element)
            except SspError as error:
                self.problems += error.problems
            node.implementation = element.get("implementation", "any")
            node.step, faults = read_step(element, where)
            self.problems += faults
        return node
