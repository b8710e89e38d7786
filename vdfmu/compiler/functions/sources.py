"""Digests of the sources that decide a result: a module and all its imports, read from the text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path

import casadi as ca

from vdfmu.base.files import PACKAGE, source_bytes

_IMPORT = re.compile(r"^ *(?:from vdfmu([\w.]*) import (\([^)]*\)|.*)|import vdfmu([\w.]*))", re.MULTILINE)
_NAME = re.compile(r"\w+")


@cache
def source_digest(*roots: str) -> str:
    """Digest of modules, ``arm.kernel``, or packages, ``compiler``, with their imports and the version of CasADi."""
    digest = sha256(ca.CasadiMeta.version().encode())
    for name in imported(*roots):
        digest.update(f"{name} {_source(name)[0]}\n".encode())
    return digest.hexdigest()


def imported(*roots: str) -> list[str]:
    """Return the names of modules and of all their imports, late imports too, without the top of the package."""
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
        new = {each for name in new for each in _source(name)[1] if each in files} - names
    return sorted(names)


@cache
def _files() -> dict[str, Path]:
    """Return module, ``arm`` or ``arm.kernel``, to file."""
    paths = {file.relative_to(PACKAGE).with_suffix("").parts: file for file in PACKAGE.rglob("*.py")}
    named = {".".join(parts[:-1] if parts[-1] == "__init__" else parts): f for parts, f in paths.items()}
    return {name: file for name, file in named.items() if name}


@cache
def _source(name: str) -> tuple[str, frozenset[str]]:
    """Return the digest of a module, and its imported names. Some are not modules."""
    content = source_bytes(_files()[name])
    names = _imports(content.decode())
    return sha256(content).hexdigest(), frozenset([name.rpartition(".")[0], *names])


def _imports(text: str) -> Iterator[str]:
    for source, names, module in _IMPORT.findall(text):
        parts = (source or module).split(".")[1:]
        yield from (".".join(parts[: i + 1]) for i in range(len(parts)))
        yield from (".".join([*parts, name]) for name in _NAME.findall(names))
