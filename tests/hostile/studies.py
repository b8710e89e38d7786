"""Corpus: studies of sweeps whose files are changed, which are read, reported and gone on with."""

import json
import random
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import pyarrow.parquet as parquet

import vdfmu
from tests.hostile.commands import workshop
from tests.hostile.results import changed
from tests.hostile.table import Corpus
from vdfmu.base.errors import VdfmuError
from vdfmu.study.sweeps.sweep import Sweep


def _sweep(folder: Path) -> Sweep:
    return vdfmu.sweep(
        "planar_tracking", ["controller.K_p=900,1000,1100"], stop=0.02, workers=1, chunk=1, engine="fmu", out=folder
    )


@cache
def _study() -> tuple[Path, Path, Any]:
    home = Path(mkdtemp(dir=workshop()))
    done, half = home / "done", home / "half"
    rows = _rows(_sweep(done))
    shutil.copytree(done, half)
    (half / "parts").mkdir()
    table = Sweep(half).table()
    for i in range(2):
        part = table.slice(i, 1).replace_schema_metadata()
        parquet.write_table(
            part, half / f"parts/part_{i:08d}_{i:08d}.parquet", compression="zstd", write_page_checksum=True
        )
    (half / "sweep.parquet").unlink()
    return done, half, rows


def done_study() -> Path:
    return _study()[0]


def _rows(study: Sweep) -> Any:
    return study.table().sort_by("point").drop_columns("wall_s").replace_schema_metadata()


def studies(number: int, folder: Path) -> None:
    """Change a file of a study, read it and go on: the rows are those of an untouched study, or it is refused."""
    rng = random.Random(f"study {number}")
    done, half, rows = _study()
    place = folder / "out"
    shutil.copytree((done, half)[number % 2], place)
    path = rng.choice(sorted(place.rglob("*.parquet")) if rng.random() < 0.7 else [place / "sweep.json"])
    if path.suffix == ".json" and rng.random() < 0.7:
        path.write_text(json.dumps(changed(json.loads(path.read_text()), rng)))
    else:
        data = bytearray(path.read_bytes())
        match rng.randrange(4):
            case 0:
                del data[rng.randrange(len(data)) :]
            case 1:
                data += rng.randbytes(rng.choice([1, 100]))
            case _:
                for _ in range(rng.choice([1, 1, 8])):
                    data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
    before = {file: file.read_bytes() for file in place.rglob("*.parquet")}
    said = None
    try:
        study = Sweep(place)
        len(study.table()), study.failed
        study.ranges()
    except VdfmuError as error:
        said = error
    try:
        study = _sweep(place)
    except VdfmuError:
        left = [file.read_bytes() for file in place.rglob("*") if file.is_file()]
        assert all(content in left for content in before.values()), "a refused study lost a file"
        raise
    assert _rows(study).equals(rows), f"other rows: {_rows(study).to_pylist()}"
    if said:
        raise said


CORPORA = [Corpus("studies of sweeps, with changes", 200, studies, quick=4, seconds=60.0)]
