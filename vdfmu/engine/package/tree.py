"""The elements of an SSD as a tree of `Node`, with systems of other files at their places."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.engine.package import archive
from vdfmu.engine.package.archive import INSIDE
from vdfmu.engine.package.elements import Node, Scope, read_connectors, read_step
from vdfmu.engine.package.parse import NAMESPACES, version_of
from vdfmu.engine.rules import Finding, breach, finding

FMU_TYPE = "application/x-fmu-sharedlibrary"
PACKAGE_TYPE = "application/x-ssp-package"
DEFINITION_TYPE = "application/x-ssp-definition"
_SUFFIXES = {".ssp": PACKAGE_TYPE, ".ssd": DEFINITION_TYPE}


class LimitError(SspError):
    """A system over a limit of size; ends the reading."""


class TreeReader:
    """Turns the XML of systems and components into `Node` objects, and collects problems.

    A system over ``ELEMENT_LIMIT`` or ``DEPTH_LIMIT`` raises `LimitError`, since nested references multiply.
    `structure` returns the root of the SSD of a scope.
    """

    def __init__(self, structure: Callable[[Scope], Any]) -> None:
        self.problems: list[Finding] = []
        self._structure = structure
        self._open: list[str] = []
        """Systems under reading, from files or by reference, to find circles."""
        self._systems: dict[Any, dict[str | None, Any]] = {}
        """Systems by their ids, for the root of each file."""
        self._count = 0

    def _fault(self, rule: str, text: str, at: Any) -> None:
        self.problems.append(finding(rule, text, at))

    def system(self, element: Any, scope: Scope, parent: Node | None, name: str = "") -> Node:
        """Read a system with everything below it."""
        path = () if parent is None else (*parent.path, name)
        if len(path) > archive.DEPTH_LIMIT:
            text = (
                f"{scope.label}: {'.'.join(path[:3])}...: more than {archive.DEPTH_LIMIT} systems inside each other; "
            )
            raise LimitError(finding("SSP016", f"{text}that is the limit (DEPTH_LIMIT). Join some of them", element))
        node = Node(path, "system", read_connectors(element, scope), element, scope)
        for child in element.iterfind("ssd:Elements/*", NAMESPACES):
            self._count += 1
            if self._count > archive.ELEMENT_LIMIT:
                text = f"{scope.label}: the system has more than {archive.ELEMENT_LIMIT} elements, including systems "
                text += "that components refer to; that is the limit (ELEMENT_LIMIT). Look for systems that "
                text += "refer to one another many times, or split the system"
                raise LimitError(finding("SSP016", text, child))
            child_name = child.get("name")
            if child_name in node.children:
                self._fault("SSP017", f"{scope.label}: two elements are named {node.dotted(child_name)!r}", child)
            kind = child.tag.rsplit("}", 1)[1]
            if kind == "System":
                node.children[child_name] = self.system(child, scope, node, child_name)
            elif kind == "Component":
                node.children[child_name] = self._component(child, node, child_name)
            else:
                text = f"{scope.label}: {node.dotted(child_name)!r} refers to a signal dictionary, which is not read; "
                self._fault("SSP020", f"{text}connect the components themselves", child)
        return node

    def _component(self, element: Any, parent: Node, name: str) -> Node:
        """Read a component: an FMU, or a system in a package, an SSD or an element of this SSD."""
        scope = parent.scope
        node = Node((*parent.path, name), "component", read_connectors(element, scope), element, scope)
        where = f"{scope.label}: component {node.label!r}"
        source = element.get("source") or ""
        kind = element.get("type", FMU_TYPE)
        if not source:
            self._fault("SSP013", f"{where}: has no source to run; name an FMU", element)
            return node
        try:
            if source.startswith("#"):
                return self._by_reference(node, source, where)
            if kind in (PACKAGE_TYPE, DEFINITION_TYPE):
                return self._from_file(node, kind, source, where)
            if kind != FMU_TYPE:
                expected = f"expected {FMU_TYPE}, {PACKAGE_TYPE} or {DEFINITION_TYPE}"
                self._fault("SSP014", f"{where}: type {kind!r} is not supported; {expected}", element)
                return node
            member = scope.member(source, where, element)
            if member not in scope.archive:
                self._fault("SSP011", f"{where}: the package has no {member!r}", element)
            elif (other := _SUFFIXES.get(posixpath.splitext(member)[1].lower())) is not None:
                text = f"{where}: {member!r} is not an FMU; set the component's type to {other!r}"
                self._fault("SSP014", text, element)
            else:
                node.source = scope.prefix + member
        except LimitError:
            raise
        except SspError as error:
            self.problems += error.problems
        node.implementation = element.get("implementation", "any")
        node.step, faults = read_step(element, where)
        self.problems += faults
        return node

    def _from_file(self, node: Node, kind: str, source: str, where: str) -> Node:
        """Read the system of an SSD, or of a package inside the package."""
        outer, element = node.scope, node.element
        file, _, fragment = source.partition("#")
        member = outer.member(file, where, element)
        if member not in outer.archive:
            raise breach("SSP011", f"{where}: the package has no {member!r}", element)
        scope = replace(outer, aliases={})
        if kind == PACKAGE_TYPE:
            scope = replace(
                scope,
                archive=outer.archive.inside(member),
                prefix=f"{outer.prefix}{member}{INSIDE}",
                base="",
                document=fragment or "SystemStructure.ssd",
                label=f"{outer.label}: {member}",
            )
        elif fragment:
            text = f"{where}: a fragment, '#{fragment}', can follow the name of a package only"
            raise breach("SSP012", text, element)
        else:
            scope = replace(scope, base=posixpath.dirname(member), document=member)
        with self._opened(scope.prefix + scope.document, where, element):
            root = self._structure(scope)
            scope = replace(scope, version=version_of(root))
            scope.define(root)
            return self._stand_in(node, root.find("ssd:System", NAMESPACES), scope, where)

    def _by_reference(self, node: Node, source: str, where: str) -> Node:
        """Read a system of the same SSD once more, to replace a component."""
        root = node.element.getroottree().getroot()
        if root not in self._systems:
            listed = reversed(list(root.iterfind(".//ssd:System", NAMESPACES)))  # the first of an id counts
            self._systems[root] = {system.get("id"): system for system in listed}
        named = self._systems[root].get(source[1:])
        if named is None:
            raise breach("SSP015", f"{where}: source {source!r}: the SSD has no system with that id", node.element)
        with self._opened(node.scope.prefix + node.scope.document + source, where, node.element):
            if any(named is above for above in node.element.iterancestors()):
                text = f"{where}: source {source!r} is a system that holds the component itself"
                raise breach("SSP015", text, node.element)
            return self._stand_in(node, named, node.scope, where)

    @contextmanager
    def _opened(self, key: str, where: str, at: Any) -> Generator[None]:
        if key in self._open:
            circle = " -> ".join([*self._open, key])
            raise breach("SSP015", f"{where}: its system holds itself: {circle}", at)
        self._open.append(key)
        try:
            yield
        finally:
            self._open.pop()

    def _stand_in(self, node: Node, element: Any, scope: Scope, where: str) -> Node:
        """Return the system for which a component stands, under the component's name."""
        parent = Node(node.path[:-1], "system", {}, None, scope)
        inner = self.system(element, scope, parent, node.path[-1])
        inner.outer = node.element, node.scope
        for name, connector in node.connectors.items():
            other = inner.connectors.get(name)
            if other is None:
                names = ", ".join(inner.connectors) or "none"
                self._fault("SSP019", f"{where}: its system lacks connector {name!r}; it has {names}", connector.place)
            elif connector.kind != other.kind:
                text = f"{where}: connector {name!r} is of kind {connector.kind}, its system says {other.kind}"
                self._fault("SSP019", text, connector.place)
            else:  # the component may state an open type and unit
                open_type, open_unit = other.type or connector.type, other.unit or connector.unit
                inner.connectors[name] = replace(other, type=open_type, unit=open_unit)
        return inner
