"""`load_ssp`: from the file to a flattened `System`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vdfmu.errors import SspError
from vdfmu.ssp.archive import NAMESPACES, Archive, parse_ssp_xml, resolve
from vdfmu.ssp.bindings import Bindings
from vdfmu.ssp.elements import Node, read_connectors, read_units
from vdfmu.ssp.structure import Component, Connector, System
from vdfmu.ssp.wiring import Wiring

FMU_TYPE = "application/x-fmu-sharedlibrary"


def load_ssp(path: str | Path) -> System:
    """Read a system structure package (SSP 1.0) and flatten it.

    Nested systems, system connectors and signal dictionaries are resolved to connections from component
    to component; parameter bindings of all levels to one value a variable (a higher level wins over a lower
    one, a later binding over an earlier one of its level).

    Parameters
    ----------
    path : str or Path
        The ``.ssp`` file.

    Returns
    -------
    System
        Faults of the wiring, such as two sources for one connector, are in its `problems`, so that
        `vdfmu.cosim.check_system` can report them together with those that only the FMUs show.

    Raises
    ------
    SspError
        The file cannot be understood: no zip, an entry outside the package, a missing resource, a member
        over the size limit, XML with a document type, a violation of the schemas, an element this reader
        does not know. All problems of these kinds that were found are listed.
    """
    path = Path(path)
    with Archive(path, path.name) as archive:
        if "SystemStructure.ssd" not in archive:
            raise SspError(f"{path.name}: the package has no 'SystemStructure.ssd'")
        data = archive.read("SystemStructure.ssd")
        root = parse_ssp_xml(data, "ssd", f"{path.name}: SystemStructure.ssd")
        reader = _Reader(archive, path.name)
        top = reader.system(root.find("ssd:System", NAMESPACES), None)
        wiring = Wiring(top)
        bindings = Bindings(archive, wiring, read_units(root.find("ssd:Units", NAMESPACES)), path.name)
        bindings.collect(top)
        problems = reader.problems + bindings.fatal
        if problems:
            raise SspError(problems)
        experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
        start, stop = (
            (None, None)
            if experiment is None
            else (_number(experiment.get("startTime")), _number(experiment.get("stopTime")))
        )
        return System(
            path=path,
            name=root.get("name"),
            components=tuple(
                Component(
                    node.label, node.source, node.implementation, node.connectors, bindings.of(node.label)
                )
                for node in _components(top)
            ),
            connections=tuple(wiring.flatten()),
            units=read_units(root.find("ssd:Units", NAMESPACES)),
            start=start,
            stop=stop,
            problems=tuple(wiring.problems),
            unmatched=tuple(bindings.unmatched),
        )


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)


def _components(node: Node) -> Iterator[Node]:
    for child in node.children.values():
        if child.kind == "component":
            yield child
        else:
            yield from _components(child)


class _Reader:
    """Turns the XML of systems and components into `Node` objects; keeps the problems it meets."""

    def __init__(self, archive: Archive, label: str) -> None:
        self.archive = archive
        self.label = label
        self.problems: list[str] = []

    def system(self, element: Any, parent: Node | None, name: str = "") -> Node:
        path = () if parent is None else (*parent.path, name)
        node = Node(path, "system", read_connectors(element), element)
        self._dictionaries(node, element, parent)
        for child in element.iterfind("ssd:Elements/*", NAMESPACES):
            child_name = child.get("name")
            if child_name in node.children:
                self.problems.append(f"{self.label}: two elements are named {node.dotted(child_name)!r}")
            tag = child.tag.rsplit("}", 1)[1]
            if tag == "System":
                node.children[child_name] = self.system(child, node, child_name)
            elif tag == "Component":
                node.children[child_name] = self.component(child, node, child_name)
            else:
                node.children[child_name] = self.dictionary_reference(child, node, child_name)
        return node

    def component(self, element: Any, parent: Node, name: str) -> Node:
        node = Node((*parent.path, name), "component", read_connectors(element), element)
        where = f"{self.label}: component {node.label!r}"
        kind = element.get("type", FMU_TYPE)
        if kind != FMU_TYPE:
            self.problems.append(f"{where}: type {kind!r} is not supported; only FMUs ({FMU_TYPE}) are")
            return node
        try:
            node.source = resolve(element.get("source"), where)
            if node.source not in self.archive:
                self.problems.append(f"{where}: the package has no {node.source!r}")
        except SspError as error:
            self.problems += error.problems
        node.implementation = element.get("implementation", "any")
        return node

    def _dictionaries(self, node: Node, element: Any, parent: Node | None) -> None:
        node.dictionaries = {} if parent is None else dict(parent.dictionaries)
        for item in element.iterfind("ssd:SignalDictionaries/ssd:SignalDictionary", NAMESPACES):
            where = f"{self.label}: signal dictionary {node.dotted(item.get('name'))!r}"
            try:
                source = item.get("source")
                if source:
                    member = resolve(source, where)
                    root = parse_ssp_xml(self.archive.read(member), "ssb", f"{self.label}: {member}")
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
                    None if kind is None else kind.get("unit"),
                )  # fmt: skip
            node.dictionaries[item.get("name")] = ((*node.path, item.get("name")), entries)

    def dictionary_reference(self, element: Any, parent: Node, name: str) -> Node:
        node = Node((*parent.path, name), "dictionary", read_connectors(element), element)
        found = parent.dictionaries.get(element.get("dictionary"))
        if found is None:
            self.problems.append(
                f"{self.label}: {node.label!r} refers to signal dictionary "
                f"{element.get('dictionary')!r}, which does not exist"
            )
            return node
        node.path, entries = ("signal dictionary", *found[0]), found[1]
        for connector in node.connectors:
            if connector not in entries:
                self.problems.append(
                    f"{self.label}: signal dictionary of {name!r} has no entry {connector!r}"
                )
        node.connectors = {
            c.name: Connector(c.name, c.kind, entries[c.name].type, entries[c.name].unit)
            for c in node.connectors.values()
            if c.name in entries
        }
        return node
