"""Corpora: summaries and logs with changes, which `vdfmu report` and `vdfmu identify` read."""

import copy
import json
import os
import random
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

import vdfmu
from tests.hostile.commands import workshop
from tests.hostile.table import Corpus
from vdfmu.arm.robot import Robot
from vdfmu.engine.package_run import run_system
from vdfmu.study.identify.log import read_log
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
    report_page([run, run])
    run_panel(run.summary)
    verdict_table(run.summary)
    for sheet in sheets(run.summary):
        sheet_table(sheet)


@cache
def _log() -> str:
    t = 1e-3 * np.arange(600)
    columns = {"time": t}
    for name in ("plant.q", "plant.kappa", "controller.tau"):
        columns |= {f"{name}[{i}]": np.sin(9.0 * t + i) for i in (1, 2)}
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    units = ["s", *["rad"] * 4, *["N.m"] * 2]
    return "\n".join([",".join(columns), ",".join(units), *(",".join(f"{x:.9g}" for x in row) for row in rows)])


_WORDS = ("", "nan", "inf", "1e999", "x", "-1", '"', "\0", "\u202e", ",", ";", "\t", "0", "1e-300", "9" * 400)


@cache
def planar() -> Robot:
    return vdfmu.load_robot("planar_2dof")


def logs(number: int, folder: Path) -> None:
    """Read a log of a measurement in which cells, lines or bytes are changed."""
    rng = random.Random(number)
    rows = [line.split(",") for line in _log().splitlines()]
    for _ in range(rng.randint(1, 3)):
        i = min(rng.choice([0, 0, 1, rng.randrange(len(rows))]), len(rows) - 1)
        match rng.randrange(5):
            case 0:
                rows[i] = rows[i][: rng.randrange(len(rows[i]) + 1)]
            case 1:
                rows.insert(i, list(rng.choice(rows)))
            case 2:
                del rows[min(i, len(rows) - 2) : i + rng.choice([1, 1, len(rows)])]
            case _:
                if rows[i : i + 1] and rows[i]:
                    rows[i][rng.randrange(len(rows[i]))] = rng.choice(_WORDS)
        rows = rows or [[""]]
    data = bytearray("\n".join(",".join(row) for row in rows).encode())
    if rng.random() < 0.3 and data:
        data[rng.randrange(len(data))] = rng.randrange(256)
    (folder / "log.csv").write_bytes(data)
    read_log(folder / "log.csv", planar())


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
    Corpus("logs of measurements, with changes", 500, logs),
    Corpus("pipes, folders and devices as files of a run", 9, pipes, quick=9, seconds=120.0),
    # the first try makes the runs, on an empty cache
    Corpus("summaries of runs, with changes", 400, summaries, quick=40, seconds=120.0),
]
