"""Digests of the sources that decide a result: a module and all that it imports, as its text says."""

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
    """Digest of modules of vdfmu with all that they import of it, and of CasADi's version.

    Parameters
    ----------
    *roots : str
        Modules, ``arm.kernel``, or packages, ``compiler``, which stand for all modules in them.
    """
    digest = sha256(ca.CasadiMeta.version().encode())
    for name in imported(*roots):
        digest.update(f"{name} {_source(name)[0]}\n".encode())
    return digest.hexdigest()


def imported(*roots: str) -> list[str]:
    """Return the names of modules and of all that they import, late imports too, without the top of the package."""
    files = _files()
    found: set[str] = set()
    for root in roots:
        if not any(f"{name}.".startswith(f"{root}.") for name in files):
            raise ValueError(f"there is no module vdfmu.{root}")
    new = {name for name in files for root in roots if f"{name}.".startswith(f"{root}.")}
    while new:
        found |= new
        new = {each for name in new for each in _source(name)[1] if each in files} - found
    return sorted(found)


@cache
def _files() -> dict[str, Path]:
    """Return the name of each module, ``arm`` or ``arm.kernel``, to its file."""
    paths = {file.relative_to(PACKAGE).with_suffix("").parts: file for file in PACKAGE.rglob("*.py")}
    named = {".".join(parts[:-1] if parts[-1] == "__init__" else parts): f for parts, f in paths.items()}
    return {name: file for name, file in named.items() if name}


@cache
def _source(name: str) -> tuple[str, frozenset[str]]:
    """Return the digest of a module, and the names that it imports; some are not modules."""
    content = source_bytes(_files()[name])
    names = _imports(content.decode())
    return sha256(content).hexdigest(), frozenset([name.rpartition(".")[0], *names])


def _imports(text: str) -> Iterator[str]:
    for source, names, module in _IMPORT.findall(text):
        parts = (source or module).split(".")[1:]
        yield from (".".join(parts[: i + 1]) for i in range(len(parts)))
        yield from (".".join([*parts, name]) for name in _NAME.findall(names))
