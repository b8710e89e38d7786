"""Which packages of the extras of vdfmu are installed."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires, version

_REQUIREMENT = re.compile(r"([\w.-]+)(?:\[([\w,.-]+)\])?(.*)")


def installed(extra: str) -> tuple[list[str], list[str]]:
    """Return the installed packages, ``name version``, of an extra, or the required ones, and the missing ones."""
    there: list[str] = []
    missing: list[str] = []
    for text in requires("vdfmu") or []:
        requirement, _, condition = (part.strip() for part in text.partition(";"))
        wanted = re.search(r"extra == ['\"]([\w-]+)['\"]", condition)
        if (wanted[1] if wanted else "") != extra:
            continue
        match = _REQUIREMENT.match(requirement)
        assert match
        if match[1] == "vdfmu":
            for inner in match[2].split(","):
                parts = installed(inner)
                there += parts[0]
                missing += parts[1]
            continue
        try:
            there.append(f"{match[1]} {version(match[1])}")
        except PackageNotFoundError:
            missing.append(requirement)
    return there, missing
