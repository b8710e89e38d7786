"""What libraries warn their programmers of is no message of a command: nothing of it on the error output."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.warm import command
from vdfmu.base.files import data_path

LEAKS = re.compile(r"Warning|Traceback|Glyph|findfont", re.IGNORECASE)


def vdfmu(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONWARNINGS"}
    return subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", *arguments],
        cwd=folder, env=environment, capture_output=True, encoding="utf-8", timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize("way", ["--isolate", "--no-isolate"])
def test_components_whose_libraries_warn_run_without_a_word(pack, xml, tmp_path, way):
    # the font of the picture has none of these letters
    package = pack([xml.component("\u4e2d\u6587" * 20, "Loud", "y:output")])
    done = vdfmu(
        tmp_path, "run", str(package), "--step", "0.1", "--stop", "1", way, "--pictures", "png", "--out", "out"
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert (tmp_path / "out" / "signals.png").exists()


@pytest.mark.heavy
def test_a_check_of_such_components_has_none_of_it(pack, tmp_path):
    package = pack(["l Loud y:output"])
    done = vdfmu(tmp_path, "check", str(package))
    assert not LEAKS.search(done.stdout + done.stderr)


@pytest.mark.heavy
@pytest.mark.parametrize("way", ["--isolate", "--no-isolate"])
def test_a_component_that_fails_says_so_once(tmp_path, way):
    overflow = ["--set", "controller.K_p=1e300"]
    packed = vdfmu(tmp_path, "ssp", "planar_tracking", "--backend", "python", *overflow, "--out", "p.ssp")
    assert packed.returncode == 0, packed.stderr
    done = vdfmu(tmp_path, "run", "p.ssp", "--stop", "0.01", way, "--out", "out")
    assert done.returncode == 1
    assert done.stderr.count("plant failed at t = ") == 1, done.stderr
    assert not LEAKS.search(done.stderr)


@pytest.mark.parametrize("number", ["1e300", "-1e300", "1e-300", "0"])
@pytest.mark.parametrize("name", ["controller.K_p", "trajectory.q_end", "plant.f_v", "plant.q_0"])
@pytest.mark.heavy
def test_numbers_that_overflow_or_vanish_warn_of_nothing(tmp_path, name, number):
    text = (data_path("models") / "scenarios" / "planar_tracking.toml").read_text(encoding="utf-8")
    described = re.sub("(?m)^description = .*", 'description = "\u4e2d\u6587 $ _ ^ {"', text)
    (tmp_path / "s.toml").write_text(described, encoding="utf-8")
    done = command("run", "s.toml", "--stop", "0.01", "--set", f"{name}={number}", "--out", "out", cwd=tmp_path)
    assert not LEAKS.search(done.stderr), done.stderr
