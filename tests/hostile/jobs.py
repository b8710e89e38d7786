"""Every command that reads or writes files, what it finds, and whether what it leaves is whole."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as parquet

from tests.hostile.commands import BUILD, OTHER, RUN, SIMULATE, extra_tests


@dataclass(frozen=True)
class Job:
    """A command, and those before it that make what it finds."""

    words: tuple[str, ...]
    before: tuple[tuple[str, ...] | Callable[[Path], object], ...] = ()
    together: bool = False  # whether its files take their place together
    cold: bool = False  # with an empty cache: all is traced and compiled


def _half(folder: Path) -> None:
    table = parquet.read_table(folder / "out/sweep.parquet")
    (folder / "out/parts").mkdir()
    parquet.write_table(
        table.slice(0, 1).replace_schema_metadata(), folder / "out/parts/part_00000000_00000000.parquet"
    )
    (folder / "out/sweep.parquet").unlink()


def _motion(folder: Path) -> None:
    (folder / "motion.toml").write_text(
        'name = "m"\nrobot = "planar_2dof"\nstop = 1.5\nstep = 1e-3\n[motion]\n'
        'kind = "waypoints"\npoints = [[0, 0], [0.5, 0.4]]\nvelocity = 1.5\nacceleration = [4.0, 6.0]\n'
    )


def begin(folder: Path) -> None:
    """Put what is there before all into a folder: a file of the user's beside the results, and a temporary folder."""
    for name in ("out", "tmp"):
        (folder / name).mkdir()
    (folder / "out" / "mine.txt").write_text("mine")


_EARLIER = (*RUN, "0.02", *OTHER)
_SWEEP = (
    "sweep", "planar_tracking", "--vary", "controller.K_p=900,1000", "--stop", "0.02", "--workers", "1", "--chunk", "1",
    "--out", "out", "--engine", "fmu",
)  # fmt: skip
_PACKAGE = ("ssp", "planar_tracking", "--out", "arm.ssp")
_SSP = ("ssp", "planar_tracking", "--out", "out/arm.ssp")
JOBS = {
    "run": Job((*RUN, "0.02"), (_EARLIER,), together=True),
    "run, Parquet": Job((*RUN, "0.02", "--format", "csv,parquet"), (_EARLIER,), together=True),
    "simulate": Job((*SIMULATE, "0.05"), (_PACKAGE, (*SIMULATE, "0.02")), together=True),
    "sweep": Job(_SWEEP),
    "sweep, half done": Job(_SWEEP, (_SWEEP, _half)),
    "sweep, done": Job(_SWEEP, (_SWEEP,)),
    "sweep report": Job(("sweep", "report", "out"), (_SWEEP,)),
    "build": Job(BUILD, ((*BUILD, *OTHER),)),
    "ssp": Job(_SSP, ((*_SSP, *OTHER),)),
    "ssp --reference": Job(("ssp", "planar_tracking", "--reference", "--out", "out")),
    "report": Job(("report", "out"), (_EARLIER,)),
    "check of an FMU": Job(("check", "out/Plant.fmu"), (BUILD,)),
    "check of a package": Job(("check", "arm.ssp"), (_PACKAGE,)),
    "scenario motion": Job(("scenario", "motion", "motion.toml", "-o", "out/motion.png"), (_motion,)),
    "unit new": Job(("unit", "new", "brake", "--out", "out/brake.py")),
}  # fmt: skip
"""Commands with what is there before them."""
for _module in extra_tests("jobs"):
    JOBS |= _module.JOBS


def files(place: Path) -> dict[str, Any]:
    contents: dict[str, Any] = {}
    for path in sorted(place.rglob("*")):
        name = str(path.relative_to(place))
        aside = name in ("said", "out/.lock") or name.startswith(("tmp/", "cache/", "out/partial"))
        if aside or not path.is_file():
            continue
        content = path.read_bytes()
        contents[name] = content
        if path.name == "summary.json":
            summary = json.loads(content)
            contents[name] = [summary.get(key) for key in ("scenario", "stop", "files", "error")]
        elif path.name == "sweep.json":  # its seal is of its place
            contents[name] = {key: value for key, value in json.loads(content).items() if key != "seal"}
        elif path.suffix == ".html":
            contents[name] = content.rstrip().endswith(b"</html>")
        elif path.suffix == ".parquet":
            with pa.BufferReader(content) as stream:
                contents[name] = parquet.read_table(stream)
    return contents


def differing(actual: dict[str, Any], expected: dict[str, Any]) -> list[str]:
    """Return the names of files that are not the same: of tables and pages except for times."""
    return sorted(
        name
        for name in {*actual, *expected}
        if not (name in actual and name in expected and _alike(actual[name], expected[name]))
    )


def _alike(a: Any, b: Any) -> bool:
    if isinstance(a, pa.Table) and isinstance(b, pa.Table) and "wall_s" in a.column_names:
        return a.drop_columns("wall_s").equals(b.drop_columns("wall_s"))
    return a == b


def _rows(contents: dict[str, Any]) -> set[tuple[Any, ...]]:
    """Return the points of studies with the time that each has taken: one that is run again has another."""
    tables = [rows for rows in contents.values() if isinstance(rows, pa.Table) and "wall_s" in rows.column_names]
    return {pair for rows in tables for pair in zip(rows["point"].to_pylist(), rows["wall_s"].to_pylist(), strict=True)}


def require_whole(
    job: Job, code: int, before: dict[str, Any], left: dict[str, Any], after: dict[str, Any], report: str
) -> None:
    """Raise AssertionError unless a job that ended with a code left all of its results, or lost none of the earlier."""
    assert _rows(before) <= _rows(left), f"points are lost: {report}"
    if code == 0:
        assert not (names := differing(left, after)), f"not complete: {names}: {report}"
        return
    for name in {*before, *left}:
        if not name.startswith("out/parts/"):
            kept = any(
                name in side and not differing({name: left.get(name)}, {name: side[name]}) for side in (before, after)
            )
            assert kept, f"{name} is {'changed' if name in left else 'lost'}: {report}"
    if job.together:
        assert not differing(left, before) or not differing(left, after), f"old and new together: {report}"


def require_nothing_left(place: Path, report: str) -> None:
    """Raise AssertionError for temporary files, and for files that were set aside as not whole."""
    left = [*(place / "tmp").iterdir(), *place.rglob("*.tmp"), *place.rglob("*.broken*")]
    assert not left, f"{left} are left: {report}"
