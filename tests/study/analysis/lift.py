"""A mass on a vertical slide, and poses of other arms."""

import numpy as np

from vdfmu.arm.equations.harmonic_drive import deformation_derivative

POSES = {
    "planar_2dof": [0.3, -0.5], "slider_3dof": [0.4, 0.1, -0.7], "manipulator_6dof": [0.3, 0.2, 0.5, -0.4, 0.6, 0.1],
}  # fmt: skip

MASS, GRAVITY = 2.5, 9.81

ONE_JOINT = f"""
name = "lift"
description = "A mass on a vertical slide"
friction = "lumped"
gravity = [0.0, 0.0, {GRAVITY}]
tool_offset = [0.0, 0.0, 0.0]
[[joints]]
type = "prismatic"
rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
offset = [0.0, 0.0, 0.0]
[joints.link]
mass = {MASS}
centroid = [0.0, 0.0, 0.0]
inertia = 0.01
[joints.drive]
ell = 600.0
I_m = 0.01
K_f0 = 3e5
c_f = 1e-4
K_w0 = 3.0
c_w = 11.0
theta_err_amplitude = 0.0
theta_err_phase = 0.0
[joints.friction]
f_c = 4.0
f_s = 8.0
f_v = 50.0
v_s = 0.02
f_ck = 0.03
eps = 1e-2
"""


def roots(robot, f):
    """Eigenvalues of mass, spring, rotor J and damping f: M J s^3 + M f s^2 + K (M + J) s + K f = 0, beside 0."""
    K = float(1.0 / deformation_derivative(robot, np.array([MASS * GRAVITY]))[0])
    J = float(robot.I_m[0] * robot.ell[0])
    return np.roots([MASS * J, MASS * f, K * (MASS + J), K * f]), K, J
