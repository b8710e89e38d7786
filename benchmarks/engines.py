"""Work and precision of the plant's solver beside MuJoCo and Drake, on a model that all three have."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.timing import Case, measure
from benchmarks.work_precision import COSIM, INTERVAL, CoSimulation, Point, WorkPrecision
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.compiler.c.compile import native_available

TITLE = "Work and precision: the plant beside engines of robot simulation"
RK4, IMPLICITFAST = "MuJoCo, RK4", "MuJoCo, implicitfast"
RK3, RK5 = "Drake, runge_kutta3", "Drake, runge_kutta5"
METHODS = {COSIM: "", RK4: "mujoco", IMPLICITFAST: "mujoco", RK3: "pydrake", RK5: "pydrake"}
"""Method to the package that it needs beside vdfmu."""
_REFERENCE_TOLERANCE = 1e-12
_LEVELS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Errors at which the times are compared [rad]."""
_AXIS = [0.0, 0.0, 1.0]

Motion = Callable[[float], np.ndarray]
"""Positions at the compared times, (m, n) [rad], for a tolerance, a step [s] or an accuracy."""


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    if not native_available():
        report.facts["skipped"] = "the compiler of native FMUs is not installed (pip install .[native])"
        report.say(f"skipped: {report.facts['skipped']}")
        return
    found = study(
        load_robot("manipulator_6dof"), stop=0.05 if quick else 0.5, rounds=1 if quick else 5, say=report.say
    )
    tabulate(found, report)
    report.save(draw(found))


def linear_robot(robot: Robot) -> Robot:
    """Return a robot with what the engines have too: linear springs, rotors in pure rotation with viscous friction.

    Springs (2)-(3) are linear in the limit of c_f and c_w to zero. At 1e-9 their compliance differs from that by less
    than 1e-7 of itself at 100 N.m.
    """
    robot = dataclasses.replace(robot, friction="lumped", rotor_coupling=False, limits=False)
    return robot.with_parameters(c_f=1e-9, c_w=1e-9, f_c=0.0, f_s=0.0, theta_err_amplitude=0.0)


def study(robot: Robot, *, stop: float, rounds: int, say: Callable[[str], None]) -> WorkPrecision:
    """Solve the fall of the arm from rest in equilibrium, its motors free, with every method at every precision."""
    robot = linear_robot(robot)
    times = np.linspace(0.0, stop, round(stop / INTERVAL) + 1)
    accuracies = [10.0 ** (-k / 2) for k in range(6, 15)]
    levels: dict[str, Sequence[float]] = {
        COSIM: [10.0**-k for k in range(2, 10)],
        RK4: [INTERVAL / k for k in (10, 20, 50, 100, 200)],
        IMPLICITFAST: [INTERVAL / k for k in (10, 30, 100, 300, 1000, 3000)],
        RK3: accuracies[:7],
        RK5: accuracies,
    }
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        fmu = build_fmus(robot, Path(name), units=["plant"], backend="native")["plant"]
        cosim = CoSimulation(fmu, times, robot.n)
        motions: dict[str, Motion] = {COSIM: cosim}
        for method, package in METHODS.items():
            if package and find_spec(package) is None:
                say(f"without {method}: {package.removeprefix('py')} is not installed (pip install .[bench])")
            elif package:
                make = mujoco_motion if package == "mujoco" else drake_motion
                motions[method] = make(robot, times, method.rpartition(", ")[2])
        reference = cosim(_REFERENCE_TOLERANCE)
        say(f"{len(motions)} methods, {stop:g} s of free fall")
        solved: dict[str, np.ndarray] = {}

        def case(point: Point) -> Case:
            label = f"{point.method} {point.tolerance:g}"

            def solve() -> None:
                solved[label] = motions[point.method](point.tolerance)

            return Case(label, solve)

        points = [Point(method, level, math.inf, math.inf) for method in motions for level in levels[method]]
        cases = [case(point) for point in points]
        measure(cases, rounds, batch=0.0, limit=2.0 * rounds)
        for point, timed in zip(points, cases, strict=True):
            q = solved[timed.name]
            point.time, point.error = timed.best, float(np.max(np.abs(q - reference)))
        cosim.close()
    check = min((p.error for p in points if p.method != COSIM), default=math.nan)
    return WorkPrecision(robot.name, stop, check, math.nan, math.nan, points)


# ------------------------------------------------------------------ engines


def stiffness(robot: Robot) -> np.ndarray:
    """Stiffness of the linear springs (n,) [N.m/rad], link-side: flexspline and wave generator in series."""
    return 1.0 / (1.0 / robot.K_f0 + 1.0 / (robot.ell**2 * robot.K_w0))


def mujoco_motion(robot: Robot, times: np.ndarray, integrator: str) -> Motion:
    """Fall in MuJoCo at fixed steps.

    Every link has two hinges on one axis: the rotor's, with the rotor's inertia as armature and its friction, and the
    spring's. Their angles add up to the link's, and the kinetic energy is that of the plant.
    """
    mujoco: Any = import_module("mujoco")
    spec = mujoco.MjSpec()
    spec.option.gravity = -np.array(robot.gravity)  # Eq. (62) has g upward
    off = mujoco.mjtDisableBit
    spec.option.disableflags = int(off.mjDSBL_CONTACT) | int(off.mjDSBL_CONSTRAINT)
    K, J = stiffness(robot), robot.I_m * robot.ell
    body = spec.worldbody
    for i in range(robot.n):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.array(robot.rotation[i]).ravel())
        I_B = np.array(robot.inertia[i])
        body = body.add_body(
            pos=robot.offset[i], quat=quaternion, mass=float(robot.mass[i]), ipos=robot.centroid[i],
            fullinertia=[*np.diag(I_B), I_B[0, 1], I_B[0, 2], I_B[1, 2]], explicitinertial=True,
        )  # fmt: skip
        hinge = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": _AXIS}
        body.add_joint(name=f"rotor{i}", armature=float(J[i]), damping=float(robot.f_v[i]), **hinge)
        body.add_joint(name=f"spring{i}", stiffness=float(K[i]), **hinge)
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


def drake_motion(robot: Robot, times: np.ndarray, integrator: str) -> Motion:
    """Fall in Drake under error control: joints as in :func:`mujoco_motion`, with a body of no mass between them."""
    tree, mathematics, analysis = (
        import_module(f"pydrake.{name}") for name in ("multibody.tree", "math", "systems.analysis")
    )
    plant: Any = import_module("pydrake.multibody.plant").MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(-np.array(robot.gravity))
    K, J = stiffness(robot), robot.I_m * robot.ell
    frame = plant.world_frame()
    for i in range(robot.n):
        I_B = np.array(robot.inertia[i])
        about = tree.RotationalInertia(*np.diag(I_B), I_B[0, 1], I_B[0, 2], I_B[1, 2])
        inertia = tree.SpatialInertia.MakeFromCentralInertia(float(robot.mass[i]), robot.centroid[i], about)
        rotor = plant.AddRigidBody(f"rotor{i}", tree.SpatialInertia.Zero())
        link = plant.AddRigidBody(f"link{i}", inertia)
        rotation = mathematics.RotationMatrix(np.array(robot.rotation[i]))
        placed = mathematics.RigidTransform(rotation, robot.offset[i])
        base = plant.AddFrame(tree.FixedOffsetFrame(f"base{i}", frame, placed))
        damping = float(robot.f_v[i])
        turning = plant.AddJoint(tree.RevoluteJoint(f"r{i}", base, rotor.body_frame(), _AXIS, damping))
        motor = plant.AddJointActuator(f"motor{i}", turning)
        motor.set_default_rotor_inertia(float(J[i]))
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


# ------------------------------------------------------------------ reporting


def tabulate(found: WorkPrecision, report: Report) -> None:
    """Show and keep the tables and facts."""
    table = Table(
        "engines",
        f"{found.robot}, {found.stop:g} s of free fall, linear springs and viscous friction",
        [
            ("method", ""),
            ("tolerance, step [s] or accuracy", ".1e"),
            ("error [rad]", ".1e"),
            ("time [ms]", ".2f"),
        ],
    )
    for p in found.points:
        table.add(p.method, p.tolerance, p.error, 1e3 * p.time)
    table.notes += [
        f"Error: largest of all positions at times {INTERVAL * 1e3:g} ms apart, to the FMU at tolerance "
        f"{_REFERENCE_TOLERANCE:g}. Engines come as close to that as {found.check:.1e} rad: the models are the same.",
        "Time: least processor time of the whole motion, all in turns. FMU by its tolerance, MuJoCo by its fixed step, "
        "Drake by the accuracy of its error control. The engines take their steps in compiled code.",
    ]
    report.show(table)

    methods = [method for method in METHODS if found.of(method)]
    equal = Table(
        "engines_equal",
        "Time at equal error [ms], between the measured points",
        [("error [rad]", ".0e"), *[(method, ".2f") for method in methods], ("MuJoCo over FMU", ".1f"),
         ("Drake over FMU", ".1f")],
    )  # fmt: skip
    ratios: dict[str, dict[str, float]] = {"MuJoCo": {}, "Drake": {}}
    for level in _LEVELS:
        times = {method: found.time_at(method, level) for method in methods}
        ours = times[COSIM]
        row: list[float | None] = []
        for engine, kept in ratios.items():
            theirs = [t for method, t in times.items() if method.startswith(engine) and t is not None]
            if ours is not None and theirs:
                kept[f"{level:g}"] = min(theirs) / ours
            row.append(kept.get(f"{level:g}"))
        equal.add(level, *[None if t is None else 1e3 * t for t in times.values()], *row)
    equal.notes.append("Last columns: the faster of the engine's two methods over the FMU.")
    report.show(equal)
    report.facts |= {
        "points": [vars(p) for p in found.points],
        "engines_over_fmu": ratios,
        "reference_check_rad": found.check,
    }


_MARKS = {
    COSIM: (COLOURS["blue"], "o", "-"), RK4: (COLOURS["orange"], "s", "-"),
    IMPLICITFAST: (COLOURS["orange"], "D", "--"), RK3: (COLOURS["green"], "^", "-"), RK5: (COLOURS["green"], "v", "--"),
}  # fmt: skip


def draw(found: WorkPrecision) -> Figure:
    """Time over error, both logarithmic: further down and left is better."""
    figure = new_figure(7.6, 4.4)
    axes = figure.add_subplot()
    for method, (colour, mark, line) in _MARKS.items():
        points = found.of(method)
        error, time = [p.error for p in points], [1e3 * p.time for p in points]
        if points:
            axes.plot(error, time, color=colour, marker=mark, linestyle=line, markersize=5, label=method)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("largest error of a position [rad]")
    axes.set_ylabel("processor time [ms]")
    axes.set_title(
        f"{found.robot}: {found.stop:g} s of free fall, linear springs, viscous friction", loc="left"
    )
    tidy(axes)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure
