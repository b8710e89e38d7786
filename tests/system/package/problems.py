"""Texts and packages of systems to read, and what the reading of a package refuses."""

import zipfile
from pathlib import Path

import pytest

from vdfmu.base.errors import SspError
from vdfmu.engine.package.read import load_ssp


def write(path: Path, text: str, members: dict[str, bytes | str] | None = None) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in {"SystemStructure.ssd": text, **(members or {})}.items():
            file.writestr(name, data)
    return path


def problems(path: Path) -> list[str]:
    with pytest.raises(SspError) as info:
        load_ssp(path)
    return info.value.problems
