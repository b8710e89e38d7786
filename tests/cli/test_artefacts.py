"""Everything that a command writes passes the check of this project, which is that of the standards."""

import pytest

from tests.conftest import ran
from vdfmu.cli.commands import COMMANDS
from vdfmu.engine.inspect.inspection import inspect_file

WRITERS = [
    ("build planar_tracking --backend python", 4), ("build planar_tracking --backend native", 4),
    ("build slider_tracking --backend native --fmi 3.0", 4), ("ssp planar_tracking --backend python", 1),
    ("ssp slider_tracking --backend native", 1), ("ssp planar_tracking --ssp 2.0", 1),
    ("run planar_tracking --stop 0.02 --no-reference", 1), ("ssp planar_tracking --reference", 2),
]  # fmt: skip
"""Commands, and how many files they write that can be checked."""
READERS = {"check", "doctor", "judge", "report", "robot", "scenario", "sweep", "unit"}


def test_every_command_that_writes_is_among_these():
    core = {
        name
        for listed in COMMANDS.values()
        for command, _ in listed
        for name in [getattr(command, "name", "") or command.__name__]
    }
    assert core == READERS | {text.split()[0] for text, _ in WRITERS}


@pytest.mark.heavy
@pytest.mark.parametrize(("command", "count"), WRITERS, ids=[text for text, _ in WRITERS])
def test_what_a_command_writes_has_no_problems(command, count, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran(*command.split())
    files = [path for pattern in ("*.fmu", "*.ssp", "*.ssd") for path in tmp_path.rglob(pattern)]
    assert len(files) == count
    for path in files:
        report = inspect_file(path)
        assert (report.problems, report.ran) == ([], True), path
