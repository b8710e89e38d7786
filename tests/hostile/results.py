"""Corpora: summaries with changes, which `vdfmu report` reads."""

import copy
import json
import os
import random
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import vdfmu
from tests.hostile.commands import workshop
from tests.hostile.table import Corpus
from vdfmu.base.extras import extra_modules
from vdfmu.engine.package_run import run_system
from vdfmu.study.report.page import report_page
from vdfmu.study.report.sheets import run_panel, sheet_table, sheets, verdict_table
from vdfmu.study.report.shown_run import read_run

_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 3.5, 1e308, "nan", "", "x" * 300, [], [None], [[]], {}, {"a": 1}, "\u202e<script>", 10**30,
)  # fmt: skip


@cache
def _runs() -> list[Path]:
    home = Path(mkdtemp(dir=workshop()))
    vdfmu.run("planar_tracking", stop=0.02, out=home / "arm")
    run_system(home / "arm" / "system.ssp", stop=0.02, out=home / "package")
    return [home / "arm", home / "package"]


def arm_run() -> Path:
    return _runs()[0]


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, entry in entries for place in _places(entry, (*path, key)))]


def changed(summary: dict[str, Any], rng: random.Random) -> Any:
    """Return a summary in which one to three places have another value, or are gone or there twice."""
    summary = copy.deepcopy(summary)
    for _ in range(rng.randint(1, 3)):
        places = [place for place in _places(summary) if place]
        if not places:
            return summary
        *path, last = rng.choice(places)
        inside = summary
        for key in path:
            inside = inside[key]
        way = rng.randrange(4)
        if way == 0:
            del inside[last]
        elif way == 1 and isinstance(inside, list):
            inside.append(copy.deepcopy(inside[last]))
        else:
            inside[last] = rng.choice(_VALUES)
    return rng.choice(_VALUES) if rng.random() < 0.03 else summary


def summaries(number: int, folder: Path) -> None:
    """Make the page and the tables of a run whose summary is changed."""
    rng, runs = random.Random(number), _runs()
    source = runs[number % len(runs)]
    shutil.copyfile(source / "results.csv", folder / "results.csv")
    summary = changed(json.loads((source / "summary.json").read_text()), rng)
    (folder / "summary.json").write_text(json.dumps(summary))
    run = read_run(folder)
    report_page([run, run] if extra_modules("comparison") else [run])
    run_panel(run.summary)
    verdict_table(run.summary)
    for sheet in sheets(run.summary):
        sheet_table(sheet)


def pipes(number: int, folder: Path) -> None:
    """Make the page of a folder in which a file of the run is a pipe that nobody writes, a folder or a device."""
    source = arm_run()
    for name in ("summary.json", "results.csv"):
        shutil.copyfile(source / name, folder / name)
    name = ("summary.json", "results.csv", "results.parquet")[number % 3]
    (folder / name).unlink(missing_ok=True)
    match number // 3 % 3:
        case 0:
            os.mkfifo(folder / name)
        case 1:
            (folder / name).mkdir()
        case _:
            (folder / name).symlink_to("/dev/zero")
    read_run(folder)
    raise AssertionError(f"{name} was read")


CORPORA = [
    Corpus("pipes, folders and devices as files of a run", 9, pipes, quick=9, seconds=120.0),
    # the first try makes the runs, on an empty cache
    Corpus("summaries of runs, with changes", 400, summaries, quick=40, seconds=120.0),
]
