"""Limits of the cost of a package, with everything inside it."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from vdfmu.engine.rules import breach

XML_LIMIT = 64 * 2**20
"""Largest member that is read into memory, such as XML [byte]."""
MEMBER_LIMIT = 512 * 2**20
"""Largest member of any kind [byte]."""
TOTAL_LIMIT = 2 * 2**30
"""Most unpacked bytes of a package, packages and FMUs inside it included; `package_limit` changes it."""
MEMORY_LIMIT = 256 * 2**20
"""Most of these bytes in memory."""
COUNT_LIMIT = 65_535
"""Most members of a package: more need the ZIP64 format, excluded by SSP 1.0."""
DIRECTORY_LIMIT = 16 * 2**20
"""Largest directory of a zip file [byte]: some 250 for each of the most members."""
PACKAGE_LIMIT = 256
"""Most packages inside a package, on all levels; each is an open file."""
NESTING_LIMIT = 8
"""Most packages inside each other."""
ELEMENT_LIMIT = 10_000
"""Most elements of a system and its inner systems, counted at each reference."""
DEPTH_LIMIT = 32
"""Most systems inside each other, written or by reference."""
_WAY = "that is the limit. If you trust the file: --unpack-limit, or package_limit of vdfmu.engine.package.limits"

_chosen: ContextVar[int | None] = ContextVar("_chosen", default=None)


@contextmanager
def package_limit(total: int | None) -> Generator[None]:
    """Set how much may be unpacked of each package that is opened in a ``with`` block.

    Parameters
    ----------
    total : int or None [byte]
        Replaces `TOTAL_LIMIT`; None leaves it. The limits of single members and of memory change in proportion.
    """
    token = _chosen.set(_chosen.get() if total is None else total)
    try:
        yield
    finally:
        _chosen.reset(token)


def unpack_limit() -> int:
    """Return the most bytes that may be unpacked of a package opened now."""
    return _chosen.get() or TOTAL_LIMIT


@dataclass
class Budget:
    """Cost of a package with its contents, in bytes actually unpacked."""

    label: str
    scale: float
    unpacked: int = 0
    kept: int = 0
    packages: int = 0

    def spend(self, count: int, kept: bool) -> None:
        """Count bytes that were unpacked; SspError beyond the limit."""
        self.unpacked += count
        self.kept += count if kept else 0
        totals = (self.unpacked, TOTAL_LIMIT, "bytes unpacked"), (self.kept, MEMORY_LIMIT, "bytes of XML")
        for spent, limit, unit in totals:
            if spent > limit * self.scale:
                text = f"{self.label}: has more than {limit * self.scale:.0f} {unit}, including packages inside it"
                raise breach("PKG004", f"{text} and repeated members; {_WAY}")
