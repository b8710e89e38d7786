"""Types of the API, as a checker sees them in a folder outside of the project."""

import json
import os
import subprocess
import sys
from importlib.resources import files

import pytest

import vdfmu

SCRIPT = """
import vdfmu
from vdfmu.motion import waypoints
from vdfmu.unit import Unit

reveal_type(vdfmu.run("tracking"))
reveal_type(vdfmu.run("tracking", algorithm="jacobi").summary)
reveal_type(vdfmu.load_robot("arm"))
reveal_type(vdfmu.sweep)
reveal_type(waypoints)
reveal_type(Unit)
vdfmu.run("tracking", mastre="jacobi")
"""


@pytest.mark.heavy
def test_types_of_the_api_reach_a_script_outside(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    path = os.pathsep.join(sys.path)
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson", "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path})
    diagnostics = json.loads(done.stdout)["generalDiagnostics"]
    types = [each["message"] for each in diagnostics if each["severity"] == "information"]
    assert len(types) == 6
    assert 'is "Results"' in types[0] and 'is "Robot"' in types[2] and "-> Motion" in types[4]
    assert not [each for each in types if "Unknown" in each or '"Any"' in each]
    (wrong,) = (each["message"] for each in diagnostics if each["severity"] == "error")
    assert "mastre" in wrong
    # without this file checkers guess types, or take none
    assert files(vdfmu).joinpath("py.typed").is_file()
