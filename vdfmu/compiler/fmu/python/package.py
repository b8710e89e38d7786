"""Builds a Python FMU with pythonfmu; it runs in a Python that has vdfmu."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

from pythonfmu import FmuBuilder

from vdfmu.base.files import data_path, pack_zip, temporary_folder
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.compiler.fmu.content import CONTENT_PLACES, Content
from vdfmu.compiler.fmu.documentation import documentation_files
from vdfmu.compiler.unit.base import is_shipped, snake_case

# Imported early, because pythonfmu puts a copy of itself into every FMU, without the binaries for builds, and a process
# that loads such an FMU first would import the copy instead of the installed package.
_LEFT_OUT = "resources/pythonfmu/"


def build_python_fmu(content: Content, path: Path) -> None:
    """Write the FMU of a content."""
    folder = data_path("fmu_src")
    file = folder / f"{snake_case(content.model_name)}.py"
    if not (is_shipped(content.unit) and file.is_file()):
        file = folder / "unit.py"
    text = file.read_text(encoding="utf-8").replace("ModelSlave", f"{content.model_name}Slave")
    text = text.replace('"Model"', f'"{content.model_name}"')
    with temporary_folder("vdfmu_build_") as folder:
        script = Path(folder) / f"vdfmu_{content.interface.name}_slave.py"
        script.write_text(text, encoding="utf-8")
        files = {CONTENT_PLACES["python"]: content.to_json().encode(), **content.robot_files}
        if not content.interface.functions.shipped:
            files |= {f"resources/{name}": text for name, text in content.interface.functions.sources.items()}
        for name, text in files.items():
            resource = Path(folder) / name
            resource.parent.mkdir(parents=True, exist_ok=True)
            resource.write_bytes(text)
        resources = sorted((Path(folder) / "resources").iterdir())
        search_path = list(sys.path)
        try:
            with InterruptGuard():  # it makes a temporary folder
                raw = FmuBuilder.build_FMU(script, dest=folder, project_files=resources)
        finally:
            sys.path[:] = search_path
        with zipfile.ZipFile(raw) as archive:
            names = [name for name in archive.namelist() if not name.startswith(_LEFT_OUT)]
            members = {name: archive.read(name) for name in names}
    pack_zip(path, members | documentation_files(content))
