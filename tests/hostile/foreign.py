"""Corpus: runs and studies of others that are looked at. Nothing of them runs, or is written elsewhere."""

import io
import json
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as parquet
from click.testing import CliRunner

from tests.cc import CC
from tests.hostile.results import arm_run
from tests.hostile.studies import done_study
from tests.hostile.table import Corpus
from vdfmu.base.files import PAGE_MARK
from vdfmu.cli.commands import app

Look = Callable[[], object]
"""A look at something that was made in the folder ``given``. Code in it would write a file beside this folder."""


def _command(*words: object) -> None:
    if error := CliRunner().invoke(app, [str(word) for word in words]).exception:
        raise error


def _packed(place: Path, change: Callable[[str, bytes], bytes]) -> Look:
    shutil.copytree(arm_run(), place)
    with zipfile.ZipFile(place / "system.ssp") as package:
        members = {name: package.read(name) for name in package.namelist()}
    for name, content in members.items():
        if name.endswith(".fmu"):
            packed = io.BytesIO()
            with zipfile.ZipFile(io.BytesIO(content)) as before, zipfile.ZipFile(packed, "w") as after:
                for member in before.namelist():
                    after.writestr(member, change(member, before.read(member)))
            members[name] = packed.getvalue()
    with zipfile.ZipFile(place / "system.ssp", "w") as package:
        for name, content in members.items():
            package.writestr(name, content)
    return partial(_command, "report", place)


def _library(place: Path) -> Path:
    """Return a library that writes a file when it is loaded."""
    source, library = place.with_suffix(".c"), place.with_suffix(".so")
    source.write_text(
        "#include <stdio.h>\n__attribute__((constructor)) static void run(void) "
        f'{{ fclose(fopen({json.dumps(str(place.with_name("ran")))}, "w")); }}\n'
    )
    subprocess.run([*CC, "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def native(place: Path) -> Look:
    """Report a run whose libraries do harm when they are loaded."""
    library = _library(place).read_bytes()
    return _packed(place, lambda name, content: library if name.endswith(".so") else content)


def sources(place: Path) -> Look:
    """Report a run whose C takes in a file of the reader."""
    secret = place.with_name("secret")
    secret.write_text("x" * 99)
    more = f'\nextern const char *volatile out; const char *volatile out = (const char[]){{\n#embed "{secret}"\n}};\n'
    report = _packed(place, lambda name, content: content + more.encode() if name == "sources/unit.c" else content)

    def look() -> None:
        report()
        assert '"binaries"' not in (place / "report.html").read_text(), "C of others was compiled"

    return look


def _studied(place: Path, *words: str, **facts: Any) -> Look:
    """Copy a study with other facts."""
    table = parquet.read_table(done_study() / "sweep.parquet")
    metadata = json.loads(table.schema.metadata[b"vdfmu"]) | facts
    for name in facts.get("measures", ()):
        table = table.append_column(name, table["controller.K_p"])
    place.mkdir()
    parquet.write_table(table.replace_schema_metadata({"vdfmu": json.dumps(metadata)}), place / "sweep.parquet")
    return partial(_command, *words, place)


def _with_code(place: Path, *words: str) -> Look:
    """Copy a study, and name a file of Python in it that does harm."""
    code = place.with_name("unit.py")
    code.write_text(f"open({str(place.with_name('ran'))!r}, 'w').close()\n")
    return _studied(place, *words, options={"units": {"controller": str(code)}})


def study_code(place: Path) -> Look:
    """Report a study that names a file of Python."""
    return _with_code(place, "sweep", "report")


def point_code(place: Path, *more: str) -> Look:
    """Run a point of it."""
    return _with_code(place, "run", *more, "--out", str(place / "out"), "--from")


def scenario_name(place: Path) -> Look:
    """Report a study whose scenario has the name of a folder of results."""
    victim = shutil.copytree(arm_run(), place.with_name("results"))
    return _studied(place, "sweep", "report", scenario=str(victim))


def page_link(place: Path) -> Look:
    """Report a run whose page is a link to another page."""
    other = place.with_name("other.html")
    other.write_bytes(PAGE_MARK)
    shutil.copytree(arm_run(), place)
    (place / "report.html").unlink()
    (place / "report.html").symlink_to(other)
    return partial(_command, "report", place)


def folder_link(place: Path) -> Look:
    """Report a run that failed, whose rows are behind a link."""
    place.mkdir()
    (place / "partial").symlink_to(shutil.copytree(arm_run(), place.with_name("results")))
    return partial(_command, "report", place)


def list_link(place: Path) -> Look:
    """List runs in a folder in which the list is a link to a file that is not there yet."""
    shutil.copytree(arm_run(), place / "run")
    (place / "index.html").symlink_to(place.with_name("written"))
    return partial(_command, "report", place)


LOOKS = (
    native, sources, study_code, point_code, scenario_name, page_link, folder_link, list_link,
)  # fmt: skip


def files(folder: Path) -> dict[Path, bytes]:
    inputs = folder / "given"
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and inputs not in path.parents}


def look(number: int, folder: Path) -> None:
    """Look at something of others; nothing beside it may change."""
    attempt = LOOKS[number % len(LOOKS)](folder / "given")
    before = files(folder)
    try:
        attempt()
    finally:
        after = files(folder)
        assert after == before, f"changed: {sorted(str(path) for path in after.keys() ^ before.keys())}"


CORPORA = [Corpus("runs and studies from elsewhere", len(LOOKS), look, quick=len(LOOKS), seconds=120.0)]
