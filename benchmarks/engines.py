"""Work and precision of the plant's solver beside MuJoCo and Drake, on a model that all three have."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Report
from benchmarks.work_precision import COSIM, INTERVAL, CoSimulation, Motion, WorkPrecision, compare, tabulate
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot

TITLE = "Work and precision: the plant beside engines of robot simulation"
MUJOCO = ("RK4", "discrete", "implicit", "implicitfast")
DRAKE = ("runge_kutta3", "runge_kutta5")
_AXIS = [0.0, 0.0, 1.0]


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    robot = load_robot("manipulator_6dof")
    precision = study(robot, 0.05 if quick else 0.5, 1 if quick else 5, report.say)
    tabulate(precision, report, "free fall, linear springs and viscous friction")


def linear_robot(robot: Robot) -> Robot:
    """Return a robot with what the engines have too: linear springs, rotors in pure rotation with viscous friction.

    Springs (2)-(3) are linear in the limit of c_f and c_w to zero. At 1e-9 their compliance differs from that by less
    than 1e-7 of itself at 100 N.m.
    """
    robot = dataclasses.replace(robot, friction="lumped", rotor_coupling=False, limits=False)
    return robot.with_parameters(c_f=1e-9, c_w=1e-9, f_c=0.0, f_s=0.0, theta_err_amplitude=0.0)


def study(robot: Robot, stop: float, rounds: int, say: Callable[[str], None]) -> WorkPrecision:
    """Solve the fall of the arm from rest in equilibrium, its motors free, with every method at every precision."""
    robot = linear_robot(robot)
    times = np.linspace(0.0, stop, round(stop / INTERVAL) + 1)
    K = 1.0 / (1.0 / robot.K_f0 + 1.0 / (robot.ell**2 * robot.K_w0))  # flexspline and wave generator in series
    steps = [INTERVAL / k for k in (10, 30, 100, 300, 1000, 3000)]
    accuracies = [10.0 ** (-k / 2) for k in range(6, 15)]
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        cosim = CoSimulation(
            build_fmus(robot, Path(name), units=["plant"], backend="native", folded=True)["plant"], times, robot.n
        )
        methods: dict[str, tuple[Motion, Sequence[float]]] = {COSIM: (cosim, [10.0**-k for k in range(2, 10)])}
        for package, integrators, make, levels in (
            ("mujoco", MUJOCO, mujoco_motion, steps), ("pydrake", DRAKE, drake_motion, accuracies),
        ):  # fmt: skip
            if find_spec(package) is None:
                say(f"without {package}, which is not installed")
                continue
            methods |= {f"{package} {each}": (make(robot, K, times, each), levels) for each in integrators}
        if "mujoco RK4" in methods:
            methods["mujoco RK4"] = methods["mujoco RK4"][0], [INTERVAL / k for k in (10, 20, 50, 100, 200)]
        precision = compare(robot, stop, methods, rounds)
        cosim.close()
    return precision


def mujoco_spec(robot: Robot, K: np.ndarray | None = None) -> Any:
    """Return the same links for MuJoCo, rigid, or with springs and rotors.

    Then every link has two hinges on one axis: the rotor's, with the rotor's inertia as armature and its friction, and
    the spring's. Their angles add up to the link's, and the kinetic energy is that of the plant.
    """
    mujoco: Any = import_module("mujoco")
    spec = mujoco.MjSpec()
    spec.option.gravity = -np.array(robot.gravity)  # Eq. (62) has g upward
    off = mujoco.mjtDisableBit
    spec.option.disableflags = int(off.mjDSBL_CONTACT) | int(off.mjDSBL_CONSTRAINT)
    body, hinge = spec.worldbody, {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": _AXIS}
    for i in range(robot.n):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.array(robot.rotation[i]).ravel())
        I_B = np.array(robot.inertia[i])
        body = body.add_body(
            name=f"body{i}", pos=robot.offset[i], quat=quaternion, mass=float(robot.mass[i]), ipos=robot.centroid[i],
            fullinertia=[*np.diag(I_B), I_B[0, 1], I_B[0, 2], I_B[1, 2]], explicitinertial=True,
        )  # fmt: skip
        if K is not None:
            J = float(robot.I_m[i] * robot.ell[i])
            body.add_joint(name=f"rotor{i}", armature=J, damping=float(robot.f_v[i]), **hinge)
        body.add_joint(name=f"link{i}", stiffness=0.0 if K is None else float(K[i]), **hinge)
    return spec


def mujoco_motion(robot: Robot, K: np.ndarray, times: np.ndarray, integrator: str) -> Motion:
    """Fall in MuJoCo at fixed steps."""
    mujoco: Any = import_module("mujoco")
    model = mujoco_spec(robot, K).compile()
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    start = np.asarray(equilibrium_torque(robot, np.zeros(robot.n)), dtype=float) / K

    def motion(step: float) -> np.ndarray:
        model.opt.timestep = step
        data = mujoco.MjData(model)
        data.qpos[0::2], data.qpos[1::2] = start, -start
        rows = [np.zeros(robot.n)]
        for _ in times[1:]:
            mujoco.mj_step(model, data, nstep=round(INTERVAL / step))
            rows.append(data.qpos[0::2] + data.qpos[1::2])
        return np.array(rows)

    return motion


def drake_motion(robot: Robot, K: np.ndarray, times: np.ndarray, integrator: str) -> Motion:
    """Fall in Drake under error control: joints as in :func:`mujoco_spec`, with a body of no mass between them."""
    tree, mathematics, analysis, plants = (
        import_module(f"pydrake.{name}") for name in ("multibody.tree", "math", "systems.analysis", "multibody.plant")
    )
    plant: Any = plants.MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(-np.array(robot.gravity))
    frame = plant.world_frame()
    for i in range(robot.n):
        I_B = np.array(robot.inertia[i])
        about = tree.RotationalInertia(*np.diag(I_B), I_B[0, 1], I_B[0, 2], I_B[1, 2])
        inertia = tree.SpatialInertia.MakeFromCentralInertia(float(robot.mass[i]), robot.centroid[i], about)
        rotor = plant.AddRigidBody(f"rotor{i}", tree.SpatialInertia.Zero())
        link = plant.AddRigidBody(f"link{i}", inertia)
        placed = mathematics.RigidTransform(mathematics.RotationMatrix(np.array(robot.rotation[i])), robot.offset[i])
        base = plant.AddFrame(tree.FixedOffsetFrame(f"base{i}", frame, placed))
        damping = float(robot.f_v[i])
        turning = plant.AddJoint(tree.RevoluteJoint(f"r{i}", base, rotor.body_frame(), _AXIS, damping))
        motor = plant.AddJointActuator(f"motor{i}", turning)
        motor.set_default_rotor_inertia(float(robot.I_m[i] * robot.ell[i]))
        motor.set_default_gear_ratio(1.0)
        bending = plant.AddJoint(tree.RevoluteJoint(f"s{i}", rotor.body_frame(), link.body_frame(), _AXIS))
        plant.AddForceElement(tree.RevoluteSpring(bending, 0.0, float(K[i])))
        frame = link.body_frame()
    plant.Finalize()
    start = np.asarray(equilibrium_torque(robot, np.zeros(robot.n)), dtype=float) / K

    def motion(accuracy: float) -> np.ndarray:
        simulator = analysis.Simulator(plant)
        context = simulator.get_mutable_context()
        plant.SetPositions(context, np.column_stack([start, -start]).ravel())
        analysis.ResetIntegratorFromFlags(simulator, integrator, INTERVAL)
        simulator.get_mutable_integrator().set_target_accuracy(accuracy)
        simulator.Initialize()
        rows = [np.zeros(robot.n)]
        for time in times[1:]:
            simulator.AdvanceTo(float(time))
            angles = plant.GetPositions(context)
            rows.append(angles[0::2] + angles[1::2])
        return np.array(rows)

    return motion
