"""The elements of an SSD as a tree of `Node`, with the systems that other files describe in their places."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from vdfmu.engine.ssp import limits
from vdfmu.engine.ssp.archive import Archive
from vdfmu.engine.ssp.elements import Node, Scope, read_connectors, read_units
from vdfmu.engine.ssp.parse import NAMESPACES, parse_ssp_xml
from vdfmu.engine.ssp.structure import Connector
from vdfmu.errors import SspError

FMU_TYPE = "application/x-fmu-sharedlibrary"
PACKAGE_TYPE = "application/x-ssp-package"
DEFINITION_TYPE = "application/x-ssp-definition"
_SUFFIXES = {".ssp": PACKAGE_TYPE, ".ssd": DEFINITION_TYPE}


class LimitError(SspError):
    """A system over a limit of size, which ends the reading."""


class TreeReader:
    """Turns the XML of systems and components into `Node` objects; keeps the problems it meets.

    A system over ``ELEMENT_LIMIT`` or ``DEPTH_LIMIT`` raises `LimitError`: references to systems that refer to
    systems multiply.

    Parameters
    ----------
    structure : callable
        Returns the root of an SSD, given the package, the member and the label of the package.
    """

    def __init__(self, structure: Callable[[Archive, str, str], Any]) -> None:
        self.problems: list[str] = []
        self._structure = structure
        self._open: list[str] = []
        """The systems that are being read from files or by reference, to find circles."""
        self._roots: dict[str, Any] = {}
        """The SSDs that components name; each is parsed once."""
        self._count = 0

    def system(self, element: Any, scope: Scope, parent: Node | None, name: str = "") -> Node:
        """Read a system with everything below it."""
        path = () if parent is None else (*parent.path, name)
        if len(path) > limits.DEPTH_LIMIT:
            raise LimitError(
                f"{scope.label}: {'.'.join(path[:3])}...: more than {limits.DEPTH_LIMIT} systems inside each other; "
                "that is the limit (DEPTH_LIMIT). Join some of them"
            )
        node = Node(path, "system", read_connectors(element, scope), element, scope)
        self._dictionaries(node, element, parent)
        for child in element.iterfind("ssd:Elements/*", NAMESPACES):
            self._count += 1
            if self._count > limits.ELEMENT_LIMIT:
                raise LimitError(
                    f"{scope.label}: the system has more than {limits.ELEMENT_LIMIT} elements, those of systems "
                    "that components refer to included; that is the limit (ELEMENT_LIMIT). Look for systems that "
                    "refer to one another many times, or split the system"
                )
            child_name = child.get("name")
            if child_name in node.children:
                self.problems.append(f"{scope.label}: two elements are named {node.dotted(child_name)!r}")
            tag = child.tag.rsplit("}", 1)[1]
            if tag == "System":
                node.children[child_name] = self.system(child, scope, node, child_name)
            elif tag == "Component":
                node.children[child_name] = self.component(child, node, child_name)
            else:
                node.children[child_name] = self.dictionary_reference(child, node, child_name)
        return node

    def component(self, element: Any, parent: Node, name: str) -> Node:
        """Read a component: an FMU, or a system that a package, an SSD or an element of this SSD describes."""
        scope = parent.scope
        node = Node((*parent.path, name), "component", read_connectors(element, scope), element, scope)
        where = f"{scope.label}: component {node.label!r}"
        source = element.get("source") or ""
        kind = element.get("type", FMU_TYPE)
        if not source:
            self.problems.append(f"{where}: has no source, so that there is nothing to run; name an FMU")
            return node
        try:
            if source.startswith("#"):
                return self._by_reference(node, source, where)
            if kind in (PACKAGE_TYPE, DEFINITION_TYPE):
                return self._from_file(node, kind, source, where)
            if kind != FMU_TYPE:
                self.problems.append(
                    f"{where}: type {kind!r} is not supported; "
                    f"expected {FMU_TYPE}, {PACKAGE_TYPE} or {DEFINITION_TYPE}"
                )
                return node
            member = scope.member(source, where)
            if member not in scope.archive:
                self.problems.append(f"{where}: the package has no {member!r}")
            elif (other := _SUFFIXES.get(posixpath.splitext(member)[1].lower())) is not None:
                self.problems.append(f"{where}: {member!r} is no FMU; set the component's type to {other!r}")
            else:
                node.source = scope.prefix + member
        except LimitError:
            raise
        except SspError as error:
            self.problems += error.problems
        node.implementation = element.get("implementation", "any")
        return node

    def _from_file(self, node: Node, kind: str, source: str, where: str) -> Node:
        """Read the system of an SSD, or of a package inside the package."""
        outer = node.scope
        file, _, fragment = source.partition("#")
        member = outer.member(file, where)
        if member not in outer.archive:
            raise SspError(f"{where}: the package has no {member!r}")
        if kind == PACKAGE_TYPE:
            archive, prefix = outer.inside(member)
            document = fragment or "SystemStructure.ssd"
            label = f"{outer.label}: {member}"
            scope = Scope(archive, prefix, "", document, label, units=outer.units)
        elif fragment:
            raise SspError(f"{where}: a fragment, '#{fragment}', can follow the name of a package only")
        else:
            base = posixpath.dirname(member)
            scope = Scope(outer.archive, outer.prefix, base, member, outer.label, units=outer.units)
        key = scope.prefix + scope.document
        with self._opened(key, where):
            if key not in self._roots:
                self._roots[key] = self._structure(scope.archive, scope.document, scope.label)
            root = self._roots[key]
            scope.define(read_units(root.find("ssd:Units", NAMESPACES)))
            return self._stand_in(node, root.find("ssd:System", NAMESPACES), scope, where)

    def _by_reference(self, node: Node, source: str, where: str) -> Node:
        """Read a system of the same SSD once more, in the place of a component."""
        tree = node.element.getroottree()
        found = [s for s in tree.getroot().iterfind(".//ssd:System", NAMESPACES) if s.get("id") == source[1:]]
        if not found:
            raise SspError(f"{where}: source {source!r}: the SSD has no system with that id")
        with self._opened(node.scope.prefix + node.scope.document + source, where):
            if any(found[0] is above for above in node.element.iterancestors()):
                raise SspError(f"{where}: source {source!r} is a system that holds the component itself")
            return self._stand_in(node, found[0], node.scope, where)

    @contextmanager
    def _opened(self, key: str, where: str) -> Generator[None]:
        if key in self._open:
            raise SspError(f"{where}: its system holds itself: {' -> '.join([*self._open, key])}")
        self._open.append(key)
        try:
            yield
        finally:
            self._open.pop()

    def _stand_in(self, node: Node, element: Any, scope: Scope, where: str) -> Node:
        """Return the system that a component stands for, under the component's name."""
        parent = Node(node.path[:-1], "system", {}, None, scope)
        inner = self.system(element, scope, parent, node.path[-1])
        inner.outer = node.element, node.scope
        for name, connector in node.connectors.items():
            other = inner.connectors.get(name)
            if other is None:
                known = ", ".join(inner.connectors) or "none"
                self.problems.append(f"{where}: its system has no connector {name!r}; it has {known}")
            elif connector.kind != other.kind:
                self.problems.append(
                    f"{where}: connector {name!r} is of kind {connector.kind}, its system says {other.kind}"
                )
            else:  # what the system leaves open, the component may say
                inner.connectors[name] = replace(
                    other, type=other.type or connector.type, unit=other.unit or connector.unit
                )
        return inner

    def _dictionaries(self, node: Node, element: Any, parent: Node | None) -> None:
        scope = node.scope
        node.dictionaries = {} if parent is None else dict(parent.dictionaries)
        for item in element.iterfind("ssd:SignalDictionaries/ssd:SignalDictionary", NAMESPACES):
            where = f"{scope.label}: signal dictionary {node.dotted(item.get('name'))!r}"
            try:
                source = item.get("source")
                if source:
                    member = scope.member(source, where)
                    root = parse_ssp_xml(scope.archive.read(member), "ssb", f"{scope.label}: {member}")
                else:
                    root = item.find("ssb:SignalDictionary", NAMESPACES)
                    if root is None:
                        raise SspError(f"{where}: has neither a source nor an inline dictionary")
            except SspError as error:
                self.problems += error.problems
                continue
            entries: dict[str, Connector] = {}
            for entry in root.iterfind("ssb:DictionaryEntry", NAMESPACES):
                kind = next((c for c in entry if c.tag.startswith(f"{{{NAMESPACES['ssc']}}}")), None)
                entries[entry.get("name")] = Connector(
                    entry.get("name"), "inout", None if kind is None else kind.tag.rsplit("}", 1)[1],
                    None if kind is None else scope.unit(kind.get("unit")),
                )  # fmt: skip
            node.dictionaries[item.get("name")] = ((*node.path, item.get("name")), entries)

    def dictionary_reference(self, element: Any, parent: Node, name: str) -> Node:
        """Read a reference to a signal dictionary."""
        scope = parent.scope
        path = (*parent.path, name)
        node = Node(path, "dictionary", read_connectors(element, scope), element, scope)
        found = parent.dictionaries.get(element.get("dictionary"))
        if found is None:
            self.problems.append(
                f"{scope.label}: {node.label!r} refers to signal dictionary "
                f"{element.get('dictionary')!r}, which does not exist"
            )
            return node
        node.path, entries = ("signal dictionary", *found[0]), found[1]
        for connector in node.connectors:
            if connector not in entries:
                self.problems.append(
                    f"{scope.label}: signal dictionary of {name!r} has no entry {connector!r}"
                )
        node.connectors = {
            c.name: Connector(c.name, c.kind, entries[c.name].type, entries[c.name].unit)
            for c in node.connectors.values()
            if c.name in entries
        }
        return node
