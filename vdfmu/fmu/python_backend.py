"""Build of a Python FMU with pythonfmu: it runs in a Python that has vdfmu."""

from __future__ import annotations

import sys
import zipfile
from html import escape
from pathlib import Path

from pythonfmu import FmuBuilder

from vdfmu.data import data_path
from vdfmu.fmu.archive import pack_zip
from vdfmu.fmu.content import CONTENT_FILE, Content
from vdfmu.interrupt import InterruptGuard
from vdfmu.temporary import temporary_folder

__all__ = ["build_python_fmu"]

# pythonfmu puts a copy of itself into every FMU. A process that loads an FMU first would take that copy for
# the package; it lacks the binaries that a later build needs. The slaves use the installed one.
_LEFT_OUT = "resources/pythonfmu/"


def build_python_fmu(content: Content, path: Path) -> None:
    """Write the FMU of a content."""
    script = data_path("fmu_src") / "python" / f"vdfmu_{content.unit}_slave.py"
    with temporary_folder("vdfmu_build_") as folder:
        resource = Path(folder) / CONTENT_FILE
        resource.write_text(content.to_json(), encoding="utf-8")
        search_path = list(sys.path)
        try:
            with InterruptGuard():  # it has a temporary folder of its own
                raw = FmuBuilder.build_FMU(script, dest=folder, project_files=[resource])
        finally:
            sys.path[:] = search_path
        with zipfile.ZipFile(raw) as archive:
            names = [name for name in archive.namelist() if not name.startswith(_LEFT_OUT)]
            members = {name: archive.read(name) for name in names}
    members["documentation/index.html"] = _documentation(content).encode()
    pack_zip(path, members)


def _documentation(content: Content) -> str:
    """Short page inside the FMU: what it is, what it needs, its variables."""
    table = content.table()
    rows = "\n".join(
        f"<tr><td>{v.name}</td><td>{v.causality}</td><td>{v.unit or ''}</td>"
        f"<td>{escape(v.description)}</td></tr>"
        for v in table
    )
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        f"<title>{content.model_name}</title></head><body>\n<h1>{content.model_name}</h1>\n"
        f"<p>{table.description}. Robot: {escape(content.robot.name)}.</p>\n"
        f"<p>This FMU runs in a Python that has vdfmu {content.version} installed.</p>\n"
        f"<table><tr><th>variable</th><th>causality</th><th>unit</th><th>description</th></tr>\n{rows}\n</table>\n"
        "</body></html>\n"
    )
