"""Digests of the sources that determine a result: a module and all its imports, found in the text."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from vdfmu.base.files import PACKAGE, source_bytes

_IMPORT = re.compile(r"vdfmu(?<=from vdfmu|port vdfmu)\.?([\w.]*)(?: import (\([^)]*\)|.*))?")
"""The pattern starts with fixed text, because it then takes 2 ms for the package instead of 12 ms."""
_NAME = re.compile(r"\w+")
_CASADI = re.compile(rb"^import casadi", re.MULTILINE)


@cache
def source_digest(*roots: str) -> str:
    """Return the digest of modules, ``arm.kernel``, or packages, ``compiler``, with their imports.

    It includes the version of CasADi if one of them imports CasADi.
    """
    digest, names = sha256(), imported(*roots)
    if any(_source(name).uses_casadi for name in names):
        from casadi import CasadiMeta  # only then, because it takes long to import

        digest.update(CasadiMeta.version().encode())
    for name in names:
        digest.update(f"{name} {_source(name).digest}\n".encode())
    return digest.hexdigest()


def imported(*roots: str) -> list[str]:
    """Return the names of modules and all their imports, including late ones, without ``vdfmu.``."""
    files = _files()
    new: set[str] = set()
    for root in roots:
        members = {name for name in files if f"{name}.".startswith(f"{root}.")}
        if not members:
            raise ValueError(f"there is no module vdfmu.{root}")
        new |= members
    names: set[str] = set()
    while new:
        names |= new
        new = set[str]().union(*(_source(name).modules for name in new)) - names
    return sorted(names)


@cache
def _files() -> dict[str, Path]:
    """Return the file by module, ``arm`` or ``arm.kernel``."""
    paths = {str(file)[len(str(PACKAGE)) + 1 : -3]: file for file in PACKAGE.rglob("*.py")}
    return {path.replace(os.sep, ".").removesuffix(".__init__"): file for path, file in paths.items()}


class _Source(NamedTuple):
    """Return a module's digest, the modules of the package that it imports, and whether it imports CasADi."""

    digest: str
    modules: set[str]
    uses_casadi: bool


@cache
def _source(name: str) -> _Source:
    content = source_bytes(_files()[name])
    modules = _files().keys() & {name.rpartition(".")[0], *_imports(content.decode())}
    return _Source(sha256(content).hexdigest(), modules, _CASADI.search(content) is not None)


def _imports(text: str) -> Iterator[str]:
    for module, names in _IMPORT.findall(text):
        yield module
        yield from (f"{module}.{name}" if module else name for name in _NAME.findall(names))
