"""Makes new files of units: a first unit with its test, and the examples."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import data_path, replacing, source_bytes
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.compiler import unit
from vdfmu.compiler.unit.base import snake_case

_FORMS = re.compile(r"[A-Z][A-Za-z0-9]*|[a-z][a-z0-9]*(_[a-z0-9]+)*")


def new_unit(name: str, out: Path | None = None) -> tuple[Path, Path]:
    """Write the file of a new unit, which can be built, and its test, which passes; return both.

    Parameters
    ----------
    name : str
        ``MyFilter`` or ``my_filter``.
    out : path, optional
        File to write; default ``my_filter.py``. The test is ``test_my_filter.py`` in its folder.

    UsageError for a name that a class or a file cannot have, and for files that exist. StorageError if a file cannot be
    written.
    """
    camel, path = _class_and_file(name, out)
    test = path.with_name(f"test_{path.stem}.py")
    folder = data_path("examples") / "new_unit"
    texts = {path: source_bytes(folder / "unit.py"), test: source_bytes(folder / "test_unit.py")}
    names = ((b"NAME", camel.encode()), (b"FILE", path.stem.encode()))
    _write_new({file: text.replace(*names[0]).replace(*names[1]) for file, text in texts.items()})
    return path, test


def copy_examples(folder: Path) -> list[Path]:
    """Copy the example units, with their system and scenario, to a folder, and return the files.

    UsageError for files that exist. StorageError if a file cannot be written.
    """
    shipped = sorted(file for file in (data_path("examples") / "units").iterdir() if file.is_file())
    files = {folder / file.name: file.read_bytes() for file in shipped}
    _write_new(files)
    return list(files)


def _class_and_file(name: str, out: Path | None) -> tuple[str, Path]:
    """Return the name of a unit's class and its file; UsageError if they cannot have this name."""
    if not _FORMS.fullmatch(name):
        raise UsageError(
            f"name: expected CamelCase or snake_case of letters and digits, MyFilter or my_filter, got {name!r}."
        )
    camel = name if name[0].isupper() else "".join(part[:1].upper() + part[1:] for part in name.split("_"))
    path = out if out is not None else Path(f"{snake_case(name)}.py")
    stem = path.stem
    if path.suffix != ".py" or not stem.isidentifier():
        raise UsageError(f"{path}: expected a Python file that can be imported, such as my_filter.py.")
    if camel in unit.__all__:
        raise UsageError(f"name: {camel} is a name that units import from vdfmu.unit. Choose another.")
    if keyword.iskeyword(stem) or keyword.iskeyword(camel) or stem in {*sys.stdlib_module_names, "vdfmu"}:
        raise UsageError(f"{path}: {stem} is a name of Python's own, or of vdfmu. Choose another.")
    return camel, path


def _write_new(files: Mapping[Path, bytes]) -> None:
    """Write new files to a folder, which is made if necessary."""
    if there := [str(file) for file in files if file.exists()]:
        verb = "exists and is" if len(there) == 1 else "exist and are"
        raise UsageError(f"{' and '.join(there)} {verb} not replaced. Choose another name.")
    first = next(iter(files))
    try:
        first.parent.mkdir(parents=True, exist_ok=True)
        with InterruptGuard(), ExitStack() as stack:
            for file, content in files.items():
                stack.enter_context(replacing(file)).write(content)
    except OSError as error:
        for file in files:
            file.unlink(missing_ok=True)
        raise StorageError(f"{first}: cannot be written: {error.strerror}. Choose another folder.") from error
