"""The folder of a run's results: a run is written next to an earlier one and replaces it when complete."""

from __future__ import annotations

import os
import re
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from itertools import count, islice
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import closed, exists, make_folder, read_json, sync
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.measure import inches
from vdfmu.base.text import to_json
from vdfmu.engine.results.formats import FORMATS, SUFFIXES, choice_of_formats, figure_files, format_of, result_files
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, Check, verdict_of
from vdfmu.engine.run import Interrupted

SYSTEM_OUTPUTS = (*result_files(), *(f"signals.{suffix}" for suffix in SUFFIXES), "summary.json")
"""Result files of a package's run besides figures; they replace the files of an earlier run."""
PAGE = "report.html"
"""Page of a run."""
RUN_OUTPUTS = (*SYSTEM_OUTPUTS, "system.ssp", PAGE)
"""Files that a run on the command line writes and replaces."""
PARTIAL = "partial"
"""Folder, in the folder of the results, of a failed or stopped run."""
_TEMPORARY = re.compile(r"[0-9a-f]{16}\.tmp")
"""Names of unfinished files; see `vdfmu.base.files.replacing`."""
DRAWN = 20_000
"""Most rows in a picture: 8 per pixel."""


def known_formats(formats: Sequence[str]) -> None:
    """Raise UsageError for a format of results that is unknown or whose package is not installed."""
    if not formats or not all(f".{form}" in FORMATS for form in formats):
        raise UsageError(f"format: expected {choice_of_formats()}, got {','.join(formats) or 'none'}.")
    for form in formats:
        FORMATS[f".{form}"]().needs()


def known_pictures(pictures: Sequence[str], width: str) -> float:
    """Return the width of pictures [in]; UsageError for an unknown kind of picture or an invalid width."""
    unknown = [kind for kind in pictures if kind not in SUFFIXES]
    if unknown:
        raise UsageError(f"pictures: expected some of {', '.join(SUFFIXES)}, got {', '.join(unknown)}.")
    if pictures:
        picture_module()
    return inches("width", width)


def picture_module() -> ModuleType:
    """Return the module that draws figures, which is of an extra; it takes long to import."""
    return module_of_extra("picture", "pictures", "A picture")


@contextmanager
def replacing_results(folder: Path, outputs: Sequence[str], overwrite: bool) -> Generator[Path]:
    """Yield a folder in `folder` for a run to write to; if the run succeeds, its files replace the earlier run.

    A failed or stopped run leaves its rows in ``partial``, with a note in its error, and the earlier run unchanged. If
    it has no rows, it leaves nothing. A killed run leaves ``partial_PID``, and the next run removes it. Simultaneous
    runs, in threads or processes, do not interfere: the last to complete is kept.

    UsageError if the folder cannot be written to or, without `overwrite`, if it has files of these names that vdfmu did
    not write.
    """
    made, owned = not folder.exists(), None
    names = (f"partial_{os.getpid()}" + (f"_{k}" if k > 1 else "") for k in count(1))
    with _LOCK:
        partial = folder / next(name for name in names if (folder / name).absolute() not in _TAKEN)
        taken = partial.absolute()
        _TAKEN.add(taken)
    try:
        owned = _prepare(partial, folder, outputs, overwrite)
        yield partial
        with InterruptGuard(), _LOCK, _one_process(folder):
            _publish(partial, folder, outputs)
    except BaseException as error:
        if rows := [name for name in result_files() if _has_rows(partial / name)]:
            earlier = f"; {folder} is unchanged" if written(folder, outputs) else ""
            kept = getattr(error, "results", None)
            of_run = kept is not None and "error" in kept.summary  # see `keep`
            time = getattr(error, "time", None) if of_run else None
            until = "The rows so far" if time is None else f"Rows up to {time:.9g} s"
            error.add_note(f"{until} are in {_set_aside(partial, outputs) / rows[0]}{earlier}.")
        else:
            with suppress(OSError):
                _remove(partial, outputs)
            for empty in (partial, folder) if made else (partial,):
                with suppress(OSError):
                    empty.rmdir()
        raise
    finally:
        _TAKEN.remove(taken)
        if owned is not None:
            closed(owned)


_TAKEN: set[Path] = set()
"""Folders of current runs of this process."""
_LOCK = Lock()


@contextmanager
def _one_process(folder: Path) -> Generator[None]:
    """Lock a folder against other processes, if the system has such locks."""
    handle = _locked(folder, wait=True)
    try:
        yield
    finally:
        if handle is not None:
            closed(handle)


def _locked(folder: Path, wait: bool = False) -> int | None:
    """Lock a folder until this process ends, and return the lock's handle; None if it cannot be locked."""
    if os.name != "posix":
        return None
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:  # or a file system without locks
        closed(handle)
        return None
    return handle


def _remove_orphans(folder: Path, outputs: Sequence[str]) -> None:
    """Remove folders of killed runs, which have no lock and only result files."""
    for orphan in folder.glob(f"{PARTIAL}_*"):
        ours = re.fullmatch(rf"{PARTIAL}_\d+(_\d+)?", orphan.name) and not orphan.is_symlink()
        handle = _locked(orphan) if ours and orphan.is_dir() else None
        if handle is not None:
            names = {*outputs, *result_files(orphan), *figure_files(orphan)}
            if all(path.name in names or _TEMPORARY.fullmatch(path.name) for path in orphan.iterdir()):
                with suppress(OSError):
                    for path in orphan.iterdir():
                        path.unlink()
                    orphan.rmdir()
            closed(handle)


def _prepare(partial: Path, folder: Path, outputs: Sequence[str], overwrite: bool) -> int | None:
    """Make the folder of a run; return the handle of its lock."""
    try:
        names = written(folder, outputs)
        if folders := [name for name in names if (folder / name).is_dir()]:
            raise UsageError(
                f"{folder}: {', '.join(folders)} must be files, got folders. Choose another folder with --out."
            )
        foreign = sorted(set(names) - _ours(folder))
        if foreign and not overwrite:
            raise UsageError(
                f"{folder}: expected a new folder, or results of an earlier run, got {', '.join(foreign)}, not "
                "written by vdfmu. Choose another folder with --out, or replace them with --overwrite."
            )
        make_folder(folder)
        with _one_process(folder):  # retry until the new folder is locked
            _remove_orphans(folder, outputs)
            partial.mkdir(exist_ok=True)
            owned = _locked(partial)
        _remove(partial, outputs)
        return owned
    except OSError as error:
        raise UsageError(f"{folder}: cannot hold the results: {error}. Choose another folder with --out.") from error


def _has_rows(path: Path) -> bool:
    stream = format_of(path).streams
    least = stream.head(()).count("\n") + 1 if stream else 0
    try:
        with open(path, "rb") as file:
            return len(list(islice(file, least))) == least
    except OSError:
        return False


def _set_aside(partial: Path, outputs: Sequence[str]) -> Path:
    """Rename the folder of a failed run to `PARTIAL`, replacing an earlier one."""
    target = partial.with_name(PARTIAL)
    with suppress(OSError):
        if target.exists():
            _remove(target, {*outputs, *_ours(target)})  # including the page of a failed run
            target.rmdir()
        return partial.rename(target)
    return partial


def _ours(folder: Path) -> set[str]:
    """Return the names of the files of the last run."""
    try:
        names = read_json(folder / "summary.json")["files"]
        return {name for name in names if name == os.path.basename(name)}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in written(folder, (*names,)):
        (folder / name).unlink(missing_ok=True)


def _publish(partial: Path, folder: Path, outputs: Sequence[str]) -> None:
    """Move the files of a complete run to their place; the summary, which lists the files, comes last.

    Files of the earlier run are kept until then, and restored if a move fails. The new files are flushed to the disk
    before they are moved, and their names afterwards.
    """
    ours, before = _ours(folder), partial / "before"
    moved: list[tuple[Path, Path]] = []
    try:
        new = [name for name in written(partial, outputs) if name != "summary.json"] + ["summary.json"]
        old = [name for name in written(folder, outputs) if name in ours or name in new]
        for name in new:
            sync(partial / name)
        before.mkdir()
        for source, target, names in ((folder, before, old), (partial, folder, new)):
            for name in names:
                os.replace(source / name, target / name)
                moved.append((source / name, target / name))
        sync(folder)
    except OSError as error:
        with suppress(OSError):
            for source, target in reversed(moved):
                os.replace(target, source)
            before.rmdir()
        why = f"{error.strerror}: {error.filename}" if error.filename else error.strerror or error
        raise VdfmuError(f"{folder}: cannot be written: {why}. Choose another folder with --out.") from error
    with suppress(OSError):  # it contains something else
        _remove(before, old)
        before.rmdir()
        partial.rmdir()


def written(folder: Path, outputs: Sequence[str]) -> list[str]:
    """Return the names of a run's existing files, including figures and results in formats of plugins."""
    names = {*outputs, *result_files(folder), *figure_files(folder)}
    return sorted(name for name in names if exists(folder / name))


def write_summary(summary: dict[str, Any], folder: Path, files: Iterable[str] | None = None) -> None:
    """Write ``summary.json`` with the names of the run's files, by default of all existing ones.

    A later run may replace the listed files.
    """
    path = folder / "summary.json"
    names = (file.name for file in folder.iterdir()) if files is None else files
    summary["files"] = sorted({*names, path.name})
    try:
        path.write_text(to_json(summary) + "\n", encoding="utf-8")
    except OSError as error:
        raise VdfmuError(f"{path}: cannot be written: {error}. Free space or choose another folder.") from error


def keep(error: CosimError | Interrupted, folder: Path, checks: Iterable[Check] = ()) -> None:
    """Write the summary of a failed run, with its error and other checks, next to its rows."""
    results = error.results
    if results is not None:
        results.summary["error"] = str(error)
        failed = isinstance(error, CosimError)
        sentence = error.sentence if failed else f"run stopped at {error.time:.3g} s"
        end = Check("end", "Runs to its end", FAILED if failed else DOUBTFUL, sentence, str(error))
        results.summary["verdict"] = verdict_of([*checks, end])
        write_summary(results.summary, folder)
