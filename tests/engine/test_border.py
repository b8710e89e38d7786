"""The engine stands alone: it imports nothing of the arm, and a foreign package is run and checked without it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import vdfmu

ROOT = Path(vdfmu.__file__).parent
ARM = ("casadi", "matplotlib", "vdfmu.arm", "vdfmu.compiler", "vdfmu.system")


@pytest.mark.heavy
def test_vdfmu_run_runs_and_judges_a_foreign_package_where_casadi_and_matplotlib_are_missing(pack, tmp_path):
    """With its page, which imports nothing of the arm either."""
    path = pack(["r Ramp y:output", "g Gain u:input"], ["r.y -> g.u"])
    script = (
        "import sys\n"
        "class Missing:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.partition('.')[0] in ('casadi', 'matplotlib') or name.startswith('vdfmu.arm'):\n"
        "            raise ModuleNotFoundError('No module named ' + repr(name), name=name)\n"
        "sys.meta_path.insert(0, Missing())\n"
        "from vdfmu.cli import main\n"
        f"sys.argv[1:] = ['run', {str(path)!r}, '--stop', '0.2', '--step', '0.1', '--judge', '90']\n"
        f"sys.argv += ['--out', {str(tmp_path / 'out')!r}]\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"report.html", "results.csv", "summary.json"}
    assert "verdict" in json.loads((tmp_path / "out" / "summary.json").read_text())["judgement"]
