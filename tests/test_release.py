"""A release of one arm, made twice, has the same bits, and its FMUs are those that their sources make."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import pytest

from tests.docs.test_tutorials import ROOT
from vdfmu.compiler.c.platforms import this_platform
from vdfmu.compiler.fmu.verify import verify


@pytest.mark.heavy
def test_a_release_made_twice_has_the_same_bits(tmp_path):
    for name in ("one", "two"):
        command = [sys.executable, "release.py", "--only", "planar_2dof", "--platform", this_platform()]
        subprocess.run([*command, "--out", str(tmp_path / name)], cwd=ROOT, check=True, capture_output=True)
    sums = (tmp_path / "one" / "SHA256SUMS").read_text()
    assert sums == (tmp_path / "two" / "SHA256SUMS").read_text()
    names = [line.split("  ") for line in sums.splitlines()]
    assert {digest for digest, _ in names} == {
        hashlib.sha256((tmp_path / "one" / name).read_bytes()).hexdigest() for _, name in names
    }
    fmus = [name for _, name in names if name.endswith(".fmu")]
    assert len(fmus) == 10  # five units in two versions of FMI
    assert not verify(tmp_path / "one" / fmus[0])
    assert [name for _, name in names if name.endswith((".whl", ".tar.gz"))]
    assert "planar_2dof/reference/planar_2dof_reach_2.0.ssp" in sums
