"""Corpus: logs with changes, which `vdfmu identify` reads."""

import random
from functools import cache
from pathlib import Path

import numpy as np

from tests.hostile.table import Corpus
from vdfmu.arm.robot import load_robot
from vdfmu.extras.identify.log import read_log


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
    read_log(folder / "log.csv", load_robot("planar_2dof"))


CORPORA = [Corpus("logs of measurements, with changes", 500, logs)]
