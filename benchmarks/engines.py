"""Work and precision of the plant's solver beside MuJoCo and Drake, on a model that all three have."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Report
from benchmarks.work_precision import COSIM, INTERVAL, Fall, Motion, WorkPrecision, compare, tabulate
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot

TITLE = "Work and precision: the plant beside engines of robot simulation"
MUJOCO = ("RK4", "implicit", "implicitfast")
DRAKE = ("runge_kutta3", "runge_kutta5")
_AXIS = [0.0, 0.0, 1.0]


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    robot, stop = load_robot("manipulator_6dof"), 0.05 if quick else 0.5
    precision = study(robot, stop, 1 if quick else 5, report.say)
    tabulate(precision, report, f"{robot.name}, {stop:g} s of free fall, linear springs and viscous friction")


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
    K = 1.0 / (1.0 / robot.K_f0 + 1.0 / (robot.ell**2 * robot.K_w0))  # flexspline and wave generator in series
    steps = [INTERVAL / k for k in (10, 30, 100, 300, 1000, 3000)]
    accuracies = [10.0 ** (-k / 2) for k in range(6, 15)]
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        fmu = build_fmus(robot, Path(name), units=["plant"], backend="native", folded=True)["plant"]
        cosim = Fall(fmu, robot.n, stop)
        levels = [10.0**-k for k in range(2, 10)]
        methods: dict[str, tuple[Motion, Sequence[float]]] = {COSIM: (cosim.own_solver, levels)}
        for package, integrators, make, levels in (
            ("mujoco", MUJOCO, mujoco_motion, steps), ("pydrake", DRAKE, drake_motion, accuracies),
        ):  # fmt: skip
            if find_spec(package) is None:
                say(f"without {package}, which is not installed")
                continue
            methods |= {f"{package} {each}": (make(robot, K, cosim.times, each), levels) for each in integrators}
        if "mujoco RK4" in methods:
            methods["mujoco RK4"] = methods["mujoco RK4"][0], [INTERVAL / k for k in (10, 20, 50, 100, 200)]
        precision = compare(methods, rounds)
        cosim.close()
    return precision


@contextmanager
def rigid_file(robot: Robot) -> Generator[str]:
    """Write the rigid arm as MJCF, with rotors as armature, and friction."""
    from vdfmu.extras.robots import export_robot

    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        path = str(Path(folder, "arm.xml"))
        export_robot(dataclasses.replace(robot, limits=False), path, rigid=True)
        yield path


def mujoco_spec(robot: Robot) -> Any:
    """Return the rigid arm for MuJoCo, without contacts."""
    mujoco: Any = import_module("mujoco")
    with rigid_file(robot) as path:
        spec = mujoco.MjSpec.from_file(path)
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for i in range(robot.n):  # not SciPy's of the file: a fit near the robot file depends on the last bits
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.array(robot.rotation[i]).ravel())
        spec.body(f"link_{i + 1}").quat = quaternion
    return spec


def passive_spec(robot: Robot) -> Any:
    """Return the rigid arm without motors and constraints."""
    mujoco: Any = import_module("mujoco")
    spec = mujoco_spec(robot)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for part in [*spec.actuators, spec.body("tool")]:
        spec.delete(part)
    return spec


def mujoco_motion(robot: Robot, K: np.ndarray, times: Sequence[float], integrator: str) -> Motion:
    """Fall in MuJoCo at fixed steps.

    Every link has two hinges on one axis: the rotor's, with the rotor's inertia as armature and its friction, and the
    spring's. Their angles add up to the link's, and the kinetic energy is that of the plant.
    """
    mujoco: Any = import_module("mujoco")
    spec = passive_spec(robot)
    for i in range(robot.n):
        spec.body(f"link_{i + 1}").add_joint(name=f"spring_{i + 1}", axis=_AXIS, stiffness=float(K[i]))
    model = spec.compile()
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


def drake_motion(robot: Robot, K: np.ndarray, times: Sequence[float], integrator: str) -> Motion:
    """Fall in Drake under error control: joints as in :func:`mujoco_motion`, with a body of no mass between them."""
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
            simulator.AdvanceTo(time)
            angles = plant.GetPositions(context)
            rows.append(angles[0::2] + angles[1::2])
        return np.array(rows)

    return motion
