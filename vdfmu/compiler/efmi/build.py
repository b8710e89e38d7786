"""An FMU becomes an eFMU: the folder ``eFMU`` is added to it."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from pathlib import Path

from vdfmu.base.data import data_path, source_bytes
from vdfmu.base.files import pack_zip, storing
from vdfmu.compiler.efmi.block import SampledBlock
from vdfmu.compiler.efmi.galec import galec_text
from vdfmu.compiler.efmi.manifest import (
    ALGORITHM,
    MANIFEST,
    PRODUCTION,
    Origin,
    algorithm_manifest,
    content,
    production_manifest,
)
from vdfmu.compiler.efmi.production import PRECISIONS, header_text, source_text
from vdfmu.compiler.fmu.content import EFMU, Content
from vdfmu.compiler.fmu.description import document


def make_efmu(path: Path, fmu: Content, precision: str, step: float) -> None:
    """Add the folder ``eFMU`` to a native FMU.

    Parameters
    ----------
    path : Path
    fmu : Content
        What the FMU was built from.
    precision : str
        One of :data:`~vdfmu.compiler.efmi.production.PRECISIONS`.
    step : float
        Time from one step to the next [s] of a memoryless unit; a sampled one has its period.
    """
    with storing(path):
        whole = path.read_bytes()
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        pack_zip(
            path, members | {f"{EFMU}/{name}": text for name, text in _folder(fmu, whole, precision, step).items()}
        )


def _folder(fmu: Content, whole: bytes, precision: str, step: float) -> dict[str, bytes]:
    """Return path to content of the folder ``eFMU``."""
    block, kind = SampledBlock(fmu.interface, step), PRECISIONS[precision]
    origin = Origin(f"{fmu.guid} {precision} {block.period!r}", fmu.generation_tool, fmu.made_by or {})
    name = block.name
    program = galec_text(block).encode()
    code = {f"{name}.h": header_text(block, kind).encode(), f"{name}.c": source_text(block, kind).encode()}
    algorithm = document(algorithm_manifest(block, origin, (f"{name}.alg", program)))
    inside = f"{name}.fmu"
    production = document(production_manifest(block, origin, algorithm, code, (inside, whole), kind))
    manifests = {ALGORITHM: algorithm, PRODUCTION: production}
    return {
        "__content.xml": document(content(block, origin, manifests)),
        f"{ALGORITHM}/{name}.alg": program,
        f"{PRODUCTION}/{inside}": whole,
        **{f"{PRODUCTION}/{file}": text for file, text in code.items()},
        **{f"{container}/{MANIFEST}": text for container, text in manifests.items()},
        **{f"schemas/{file}": text for file, text in _schemas().items()},
    }


@lru_cache
def _schemas() -> dict[str, bytes]:
    """Return path to content of the schemas of eFMI, which every eFMU has."""
    folder = data_path("fmu_src") / "efmi" / "schemas"
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): source_bytes(file) for file in files}
