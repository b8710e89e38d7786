"""A new option of drives with a state: its own file and the list of options, no other, and the plant has it."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import vdfmu
from vdfmu.arm.robot import load_robot

OPTION = '''
"""A spring and a damper in series, beside the drive's spring (Maxwell's element)."""

from dataclasses import dataclass

from vdfmu.arm.drive.option import Array, DriveOption, OptionState, Parallel, row
from vdfmu.base.measure import POSITIVE


@dataclass(frozen=True, eq=False, kw_only=True)
class CreepRows:
    """Its parameters."""

    creep: bool = False
    K_x: Array = row("creep", "stiffness", "stiffness of the element, link-side", "", 1e12, POSITIVE)
    T_x: Array = row("creep", "s", "time in which its torque falls to 1/e", "", 1e6, POSITIVE)


CREEP = DriveOption(
    state=OptionState("tau_x", "torque", "torque of the element, link-side", "its start, without equilibrium"),
    parallel=lambda robot, stretch, tau_x: Parallel(
        torque=tau_x, loss=tau_x * tau_x / (robot.K_x * robot.T_x), energy=tau_x * tau_x / (2.0 * robot.K_x)
    ),
    rate=lambda robot, motion, tau_x: robot.K_x * motion.stretch - tau_x / robot.T_x,
)
'''

LISTED = {  # in options.py: what is there, to what follows it
    "import BRISTLES, BristlesRows\n": "from vdfmu.arm.drive.creep import CREEP, CreepRows\n",
    '"winding", "thermal"': ', "creep"',
    '    "thermal": THERMAL,\n': '    "creep": CREEP,\n',
    "class OptionRows(": "CreepRows, ",
}

RUN = """
import json, sys
import numpy as np
from vdfmu.arm.robot import robot_from_dict
from vdfmu.arm.units.plant import Plant
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.solver import Integrator
from vdfmu.compiler.unit.interface import Interface

robot = robot_from_dict(json.load(sys.stdin))
interface = Interface(Plant, robot)
solver = Integrator(Traced(interface))
solver.tolerance = 1e-9
solver.unit.group("tau")[:] = 0.02
solver.x[:] = 0.0
solver.advance(0.0, 0.05)
names = [variable.name.partition("[")[0] for variable in interface.variables]
print(json.dumps({"x": solver.x.tolist(), "names": sorted({*names} & {"tau_x", "tau_x_0", "K_x", "T_x"})}))
"""


def linear_arm():
    """Return the first link of the planar arm without gravity and friction, on springs that are nearly linear."""
    data = load_robot("planar_2dof").to_dict()
    joint = data["joints"][0]
    joint["drive"] |= {"c_f": 1e-9, "c_w": 1e-9, "theta_err_amplitude": 0.0}
    joint["friction"] |= {"f_c": 0.0, "f_s": 0.0, "f_v": 0.0}
    joint["creep"] = {"K_x": 2e3, "T_x": 0.01}
    return data | {"gravity": [0.0, 0.0, 0.0], "joints": [joint], "rotor_coupling": False, "visuals": []}


def exact(data, t):
    """Return the state at `t` of the linear equations, from rest, by the exponential of their matrix."""
    (joint,) = data["joints"]
    link, drive, creep = joint["link"], joint["drive"], joint["creep"]
    J = np.array(link["inertia"])[2, 2] + link["mass"] * np.sum(np.square(link["centroid"][:2]))
    K = 1.0 / (1.0 / drive["K_f0"] + 1.0 / (drive["ell"] ** 2 * drive["K_w0"]))
    back = 1.0 / (drive["ell"] * drive["I_m"])
    A = np.array(
        [
            [0, 1, 0, 0, 0, 0],
            [0, 0, 0, 1 / J, 1 / J, 0],
            [0, 0, 0, -back, -back, 1 / drive["I_m"]],
            [0, -K, K, 0, 0, 0],
            [0, -creep["K_x"], creep["K_x"], 0, -1 / creep["T_x"], 0],
            [0, 0, 0, 0, 0, 0],  # the motor's torque
        ]
    )
    return (expm(A * t) @ [0, 0, 0, 0, 0, 0.02])[:5]


@pytest.mark.heavy
def test_an_option_with_a_state_is_one_file_and_its_place_in_the_list(tmp_path):
    package = tmp_path / "vdfmu"
    shutil.copytree(Path(vdfmu.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__", "web"))
    (package / "arm/drive/creep.py").write_text(OPTION)
    options = package / "arm/drive/options.py"
    text = options.read_text()
    for before, more in LISTED.items():
        assert text.count(before) == 1
        text = text.replace(before, before + more)
    options.write_text(text)
    data = linear_arm()
    run = subprocess.run(
        [sys.executable, "-c", RUN], input=json.dumps(data), capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(tmp_path), "VDFMU_CACHE_DIR": str(tmp_path / "cache")}, cwd=tmp_path,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["names"] == ["K_x", "T_x", "tau_x", "tau_x_0"]
    # some thousand steps with a local error of 1e-9 (1 + |x|) each; torques reach 1
    np.testing.assert_allclose(answer["x"], exact(data, 0.05), rtol=0, atol=1e-6)
    assert abs(answer["x"][4]) > 1e-3
