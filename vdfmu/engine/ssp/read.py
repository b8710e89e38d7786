"""`load_ssp` and `read_system`: from the file to a flattened `System`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vdfmu.engine.ssp.archive import Archive
from vdfmu.engine.ssp.bindings import Bindings
from vdfmu.engine.ssp.elements import Node, Scope, read_units
from vdfmu.engine.ssp.experiment import read_experiment
from vdfmu.engine.ssp.parse import NAMESPACES, parse_ssp_xml, parse_xml
from vdfmu.engine.ssp.structure import Component, System
from vdfmu.engine.ssp.tree import TreeReader
from vdfmu.engine.ssp.wiring import Wiring
from vdfmu.errors import SspError

__all__ = ["DEFAULT", "load_ssp", "read_system", "refuse_version", "variants"]

DEFAULT = "SystemStructure.ssd"
"""The SSD that a package must have."""


def load_ssp(path: str | Path, variant: str = DEFAULT) -> System:
    """Read a system structure package (SSP 1.0) and flatten it.

    Nested systems, system connectors, signal dictionaries, packages inside the package and components that
    name another SSD are resolved to connections from component to component; parameter bindings of all levels
    to one value a variable (a higher level wins over a lower one, a later binding over an earlier one of its
    level).

    Parameters
    ----------
    path : str or Path
        The ``.ssp`` file.
    variant : str, optional
        The SSD to read, where the package has several at its root.

    Returns
    -------
    System
        Faults of the wiring, such as two sources for one connector, are in its `problems`, so that
        `vdfmu.engine.cosim.check_system` can report them together with those that only the FMUs show.

    Raises
    ------
    SspError
        The file cannot be understood: no zip, an entry outside the package, a missing resource, a member
        over the size limit, XML with a document type, a violation of the schemas, SSP 2.0, an element this
        reader does not know. All problems of these kinds that were found are listed.
    """
    system, problems = read_system(path, variant)
    if system is None or problems:
        raise SspError(problems)
    return system


def read_system(path: str | Path, variant: str = DEFAULT) -> tuple[System | None, list[str]]:
    """Read as much of a package as can be read, with all problems; `load_ssp` raises them instead.

    Returns
    -------
    System or None
        None when there is no SSD to speak of: the package or its SSD cannot be parsed, or is over a limit. Otherwise
        the system without what could not be read; a component whose FMU is not there has the source "". Its
        `problems` hold those of the reading too, so `vdfmu.engine.cosim.check_system` reports everything at once.
    list of str
        The problems of the reading, empty for a package that `load_ssp` takes.
    """
    path = Path(path)
    try:
        with Archive(path, path.name) as archive:
            return _read(archive, path, variant)
    except SspError as error:
        return None, error.problems


def _read(archive: Archive, path: Path, variant: str) -> tuple[System, list[str]]:
    root = _structure(archive, variant, path.name)
    scope = Scope(archive, "", "", variant, path.name)
    scope.define(read_units(root.find("ssd:Units", NAMESPACES)))
    reader = TreeReader(_structure)
    top = reader.system(root.find("ssd:System", NAMESPACES), scope, None)
    wiring = Wiring(top)
    bindings = Bindings(wiring)
    bindings.collect(top)
    experiment, faults = read_experiment(root, f"{path.name}: {variant}")
    problems = list(dict.fromkeys(reader.problems + bindings.fatal + faults))
    connections = tuple(wiring.flatten())
    system = System(
        path=path,
        name=root.get("name"),
        components=tuple(
            Component(
                wiring.names[node.path],
                node.source,
                node.implementation,
                node.connectors,
                bindings.of(node.path),
            )
            for node in _components(top)
        ),
        connections=connections,
        units=dict(scope.units),
        experiment=experiment,
        problems=(*problems, *wiring.problems),
        unmatched=tuple(bindings.unmatched),
        notes=(*wiring.notes, *bindings.notes),
    )
    return system, problems


def variants(archive: Archive) -> list[str]:
    """Return the SSDs at the root of a package, the default first."""
    names = [n for n in archive.names if "/" not in n and n.lower().endswith(".ssd") and n != DEFAULT]
    return [*([DEFAULT] if DEFAULT in archive.names else []), *sorted(names)]


def refuse_version(root: Any, where: str) -> None:
    """Raise SspError for an SSD of another version than 1.x."""
    version = root.get("version") or ""
    if root.tag == f"{{{NAMESPACES['ssd']}}}SystemStructureDescription" and version.startswith("2"):
        raise SspError(
            f"{where}: is SSP {version}; expected SSP 1.0, which the master reads. "
            "'vdfmu check' checks SSP 2.0; export the system as SSP 1.0 to run it"
        )


def _structure(archive: Archive, member: str, label: str) -> Any:
    """Return the root of an SSD of a package."""
    if member not in archive:
        others = variants(archive)
        has = f"; it has {', '.join(others)}" if others else ""
        raise SspError(f"{label}: the package has no {member!r}{has}")
    where = f"{label}: {member}"
    data = archive.read(member)
    refuse_version(parse_xml(data, where), where)
    return parse_ssp_xml(data, "ssd", where)


def _components(node: Node) -> Iterator[Node]:
    for child in node.children.values():
        if child.kind == "component":
            yield child
        else:
            yield from _components(child)
