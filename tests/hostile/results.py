"""Corpora: summaries and logs with changes, which `vdfmu report` and `vdfmu identify` read."""

from __future__ import annotations

import atexit
import copy
import json
import random
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import vdfmu
from vdfmu.report.page import read_run, report_page
from vdfmu.report.sheets import sheets
from vdfmu.report.tables import run_panel, sheet_table, verdict_table

from .table import Corpus

_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 3.5, 1e308, "nan", "", "x" * 300, [], [None], [[]], {}, {"a": 1}, "\u202e<script>", 10**30,
)  # fmt: skip


@cache
def _runs() -> list[Path]:
    """Return folders of a run with an arm, of one of a package, and of the contrast."""
    home = Path(mkdtemp(prefix="vdfmu_hostile_runs_"))
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    vdfmu.run("planar_tracking", stop=0.02, out=home / "arm")
    vdfmu.run("contrast", out=home / "contrast")
    return [home / "arm", home / "contrast"]


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
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
    report_page([run, run])
    run_panel(run.summary)
    verdict_table(run.summary)
    for sheet in sheets(run.summary):
        sheet_table(sheet)


CORPORA = [
    # the first try makes the runs, on an empty cache
    Corpus("summaries of runs, with changes", 1000, summaries, quick=40, seconds=120.0),
]
