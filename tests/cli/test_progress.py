"""How far tracing and compiling are: reported to who builds, and shown on a terminal only."""

import os
import subprocess
import sys

import pytest

from tests.cli.terminals import on_terminal
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.base.progress import showing


@pytest.mark.heavy
def test_each_traced_function_and_each_compiled_file_counts(tmp_path, monkeypatch):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    reports = []
    with showing(lambda *report: reports.append(report)):
        built = build_fmus(
            load_robot("planar_2dof"), tmp_path, units=["plant", "controller"], backend="native", folded=True
        )
    assert sorted(built) == ["controller", "plant"]
    stages = {stage: [report for report in reports if report[0] == stage] for stage, _, _ in reports}
    assert list(stages) == ["trace plant", "trace controller", "compile"]
    for stage, seen in stages.items():
        total = seen[0][2]
        assert total > 0
        assert seen == [(stage, done, total) for done in range(total + 1)]
    count = len(reports)
    build_fmus(load_robot("planar_2dof"), tmp_path / "again", units=["plant"], backend="native", folded=True)
    assert len(reports) == count  # nothing is shown after the block


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals of this kind")
@pytest.mark.parametrize("words", [("build", "--out", "fmus"), ("run", "--stop", "0.01")])
def test_a_terminal_shows_how_far_it_is_and_a_file_does_not(tmp_path, words):
    command = [sys.executable, "-m", "vdfmu.cli", words[0], "planar_tracking", *words[1:]]
    cache = {"VDFMU_CACHE_DIR": str(tmp_path / "cache")}
    shown = on_terminal(command, width=120, pipe=True, cwd=tmp_path, **cache)
    assert shown.code == 0
    assert "trace plant" in shown.text
    assert "compile" in shown.text
    assert b"trace" not in shown.output
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | cache, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "trace" not in done.stderr
    assert "compile" not in done.stderr
