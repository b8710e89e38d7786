"""A measured arm identified in several ways from one log, and the residual of each on the torques of another log."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from benchmarks.engines import mujoco_spec
from benchmarks.report import Report, Table
from vdfmu.arm.drive.counterbalance import counterbalance_torque
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.arrays import Floats
from vdfmu.base.files import data_path
from vdfmu.extras.identify.fit import PRIOR, LogScore, identify, score
from vdfmu.extras.identify.log import Log, read_log
from vdfmu.extras.identify.problem import base_parameters, link_covariance, regressor
from vdfmu.extras.identify.rows import Rows

TITLE = "A measured arm: the KR 300, identified in several ways"
REGRESSIONS = ("ordinary least squares", f"weighted, robot file within {100 * PRIOR:.0f} %")
"""Of a rigid arm; weighted, each axis is divided by the residual of the first solution, and errors of the robot file
are the unknowns, of the size that vdfmu takes for them."""
ITERATIONS = 20
"""Of the toolbox, at most; the sum of squares falls by less than 3e-3 of itself in twenty more."""
_DEPENDENT = 1e-8
"""Singular value, over the largest, of combinations of parameters that move no torque."""
_WIDE = 10.0
"""Factor by which the toolbox may leave the robot file's friction, rotors and springs, as its default is of masses."""
_NEAR = {"armature": 1.0 + PRIOR, "balance": 1.0 + PRIOR}
"""The same, if the robot file is near, as vdfmu takes it to be; of all else 2."""


class Fit(NamedTuple):
    """One way to identify, and what it leaves."""

    method: str
    residual: Floats
    """Residual torques on a log that was not fitted, root mean squares (n,) over those of the torques."""


class Motion(NamedTuple):
    """A rigid motion, at all samples (m, n), and the rows that are compared."""

    log: Log
    rows: Rows
    q: Floats
    q_dot: Floats
    q_ddot: Floats
    balance: Floats
    """Torque of the robot file's counterbalances on the links [N.m]."""


def run(report: Report, quick: bool = False) -> None:
    """Identify from one log in all ways, and show the residuals of the other."""
    folder = data_path("examples") / "kr300"
    robot = load_robot(folder / "nominal.toml")
    logs = [read_log(folder / f"{name}.parquet", robot) for name in "ab"]
    axes = [(f"{i + 1}", ".1f") for i in range(robot.n)]
    table = Table("kr300", "Residual torque on B, to which they were not fitted, % of each axis's",
                  [("method", ""), *axes])  # fmt: skip
    for fit in study(robot, logs[0], logs[1], report.say, 2 if quick else ITERATIONS):
        table.add(fit.method, *100.0 * fit.residual)
    report.show(table)


def study(robot: Robot, fitted: Log, other: Log, say: Callable[[str], None], iterations: int) -> list[Fit]:
    """Fit each model to one log; MuJoCo's toolbox in so many iterations at most."""
    fits: list[Fit] = []
    scores: list[LogScore] = []
    for text, prior in ((f"robot file within {100 * PRIOR:.0f} %", PRIOR), ("links unknown", np.inf)):
        model = identify(fitted, robot, prior=prior)
        scores = [score(model, robot, fitted, log) for log in (fitted, other)]
        fits.append(Fit(f"vdfmu, elastic, {text}", scores[1].torque_left / scores[1].torque))
    motions = [motion(robot, log, each.rows) for log, each in zip((fitted, other), scores, strict=True)]
    fits += [_regression(robot, motions, each) for each in REGRESSIONS]
    if (sysid := toolbox()) is None:
        say("without MuJoCo's toolbox, which is not installed (pip install 'mujoco[sysid]>=4')")
        return fits
    for near in (False, True):
        fits.append(_Arm(sysid, robot, near).fit(motions, iterations))
        say(fits[-1].method)
    return fits


def _regression(robot: Robot, motions: Sequence[Motion], method: str) -> Fit:
    """Least squares of a rigid arm, in whose parameters torques are linear (Gautier and Khalil 1990; Gautier 1997)."""
    base = base_parameters(robot)
    tables = [_columns(robot, base.columns, moved) for moved in motions]
    torques = [moved.rows.problem.tau for moved in motions]
    drives = [robot.I_m * robot.ell, robot.f_c, robot.f_v, robot.F_cb, robot.ell]
    file = np.concatenate([base.matrix @ body_parameters(robot), *drives[:4], 0.0 * robot.ell])
    shares = (0.2, 1.0, 1.0, 0.2, 1.0)  # as vdfmu's; of the constant 1 N.m of the motor
    drive_errors = np.diag(np.concatenate([share * each for share, each in zip(shares, drives, strict=True)]))
    link_errors: Any = link_covariance(robot, base, PRIOR)
    errors: Any = block_diag(np.linalg.cholesky(link_errors), drive_errors)

    def solved(weights: Floats, *near: Floats) -> Floats:
        A = (tables[0] * weights[:, None]).reshape(-1, len(file)) @ errors
        b = ((torques[0] - tables[0] @ file) * weights).ravel()
        for identity in near:
            A, b = np.vstack([A, identity]), np.append(b, 0.0 * file)
        return file + errors @ np.linalg.lstsq(A, b, rcond=_DEPENDENT)[0]

    x = solved(np.ones(robot.n))
    if method == REGRESSIONS[1]:
        x = solved(1.0 / rms(torques[0] - tables[0] @ x), np.eye(len(file)))
    return Fit(f"rigid, {method}", rms(torques[1] - tables[1] @ x) / rms(torques[1]))


def _columns(robot: Robot, base: list[int], moved: Motion) -> Floats:
    """Torques in the rows (k, n, p) by base parameters, rotors, Coulomb and viscous friction, balances, constants."""
    still = 0.0 * moved.q
    balance = -moved.balance / np.where(robot.F_cb == 0.0, 1.0, robot.F_cb)
    per_joint = (moved.q_ddot, np.tanh(moved.q_dot / robot.eps), moved.q_dot, balance, still + 1.0)
    links = regressor(robot, moved.q, moved.q_dot, moved.q_ddot, still, still).links[:, :, base]
    diagonal = [each[:, :, None] * np.eye(robot.n) for each in per_joint]
    return moved.rows.problem.narrow(np.concatenate([links, *diagonal], axis=2))


def rms(values: Floats) -> Floats:
    """Root mean squares of columns."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def toolbox() -> Any:
    """MuJoCo's toolbox for identification, None if it or a package that it needs is not installed."""
    try:
        sysid = import_module("mujoco.sysid")
    except ImportError:
        return None
    return sysid if hasattr(sysid, "optimize") else None


def motion(robot: Robot, log: Log, rows: Rows) -> Motion:
    """Return the motion of the rotors, which is that of the links of a rigid arm, as the rows of a log have it."""
    speed = rows.problem.velocity
    balance = counterbalance_torque(robot, log.kappa.T).T
    return Motion(log, rows, log.kappa, speed, np.gradient(speed, log.step, axis=0), balance)


def inverse_dynamics(model: Any, moved: Motion) -> Floats:
    """Torques of a motion (m, n) [N.m], as MuJoCo has them."""
    mujoco: Any = import_module("mujoco")
    data = mujoco.MjData(model)
    tau = np.empty_like(moved.q)
    for row, q, q_dot, q_ddot in zip(tau, moved.q, moved.q_dot, moved.q_ddot, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, q_dot, q_ddot
        mujoco.mj_inverse(model, data)
        row[:] = data.qfrc_inverse
    return tau


class _Arm:
    """The arm with what the toolbox may change, and the log as the toolbox takes it."""

    def __init__(self, sysid: Any, robot: Robot, near: bool) -> None:
        mujoco: Any = import_module("mujoco")
        self.sysid, self.robot, self.near = sysid, robot, near
        self.method = "MuJoCo, its law given" + near * ", robot file near"
        self.spec = mujoco_spec(robot)
        self.parameters = sysid.ParameterDict()
        self.transform = sysid.SignalTransform(normalize=True)
        model, joints = self.spec.compile(), [joint.name for joint in self.spec.joints]
        for i, joint in enumerate(joints):
            kind, limits = sysid.InertiaType.Pseudo, self._limits(i) if near else {}
            name = f"link_{i + 1}"
            body = sysid.body_inertia_param(
                self.spec, model, name, inertia_type=kind, modifier=self._link(name), **limits
            )
            self.parameters.add(body)
            values = {"armature": robot.I_m[i] * robot.ell[i], "damping": robot.f_v[i], "frictionloss": robot.f_c[i]}
            for attribute, value in values.items():
                self._add(joint, attribute, float(value))
            kind = mujoco.mjtSensor.mjSENS_JOINTACTFRC
            self.spec.add_sensor(name=joint, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
            bound = float(robot.ell[i])  # 1 N.m of the motor
            self.parameters.add(sysid.Parameter(f"bias{i}", 0.0, -bound, bound))
            self.transform.bias(joint, self.parameters[f"bias{i}"], target="predicted")
        if robot.counterbalance:
            self.parameters.add(sysid.Parameter("balance", 1.0, *self._bounds("balance")))
        self.names = joints

    def fit(self, motions: Sequence[Motion], iterations: int) -> Fit:
        """Fit to the first motion, and return the residual of the second."""
        residual = self.sysid.build_residual_fn(
            models_sequences=[self._whole(motions[0])], build_model=self.sysid.apply_param_modifiers,
            modify_residual=self.transform.apply, resample_true=False, custom_rollout=self._rollout(motions[0]),
        )  # fmt: skip
        lower, upper = self.parameters.get_bounds()
        values, _ = self.sysid.optimize(
            self.parameters, residual, verbose=False, max_iters=iterations, x_scale=upper - lower, output=io.StringIO()
        )
        bias = np.array([values[f"bias{i}"].value[0] for i in range(self.robot.n)])
        tau = motions[1].rows.problem.tau
        left = tau - bias - self._torques(self.sysid.apply_param_modifiers(values, self.spec), values, motions[1])
        return Fit(self.method, rms(left) / rms(tau))

    def _link(self, name: str) -> Callable[[Any, Any], None]:
        """Write the ten parameters of a body, in a form in which all values are physical."""

        def modify(spec: Any, parameter: Any) -> None:
            self.sysid.apply_body_inertia(spec, name, parameter)
            spec.body(name).iquat = [1.0, 0.0, 0.0, 0.0]  # it leaves NaN, with which MuJoCo 4.0.0 does not compile

        return modify

    def _add(self, name: str, attribute: str, value: float) -> None:
        """Fit a number of a joint."""

        def modify(spec: Any, parameter: Any) -> None:
            joint = spec.joint(name)
            fitted = float(parameter.value[0])
            setattr(joint, attribute, [fitted, 0.0, 0.0] if attribute == "damping" else fitted)  # a polynomial

        bounds = self._bounds(attribute, value)
        self.parameters.add(self.sysid.Parameter(f"{name} {attribute}", value, *bounds, modifier=modify))

    def _bounds(self, attribute: str, value: float = 1.0) -> tuple[float, float]:
        factor = _NEAR.get(attribute, 2.0) if self.near else _WIDE
        return value / factor, value * factor

    def _limits(self, i: int) -> dict[str, Floats]:
        """Bounds of a link: as shares of mass and squared sizes, of shears, and of the radius of gyration [m]."""
        both, factors = np.array([-PRIOR, PRIOR]), np.array([1.0 / (1.0 + PRIOR), 1.0 + PRIOR])
        reach = np.sqrt(np.trace(self.robot.inertia[i]) / (2.0 * self.robot.mass[i]))
        mass = {"mass_bound_mult": factors, "stretch_bound_mult": factors}
        return {**mass, "shear_bound_off": both, "ipos_bound_off": reach * both}

    def _torques(self, model: Any, parameters: Any, moved: Motion) -> Floats:
        """Torques of the motors in the rows (k, n) [N.m], link-side."""
        balance = parameters["balance"].value[0] * moved.balance if "balance" in parameters else 0.0
        return moved.rows.problem.narrow(inverse_dynamics(model, moved) - balance)

    def _whole(self, moved: Motion) -> Any:
        """Torques in the rows, as one sequence."""
        series, model = self.sysid.TimeSeries, self.spec.compile()
        t, tau = moved.rows.t, moved.rows.problem.tau
        start = self.sysid.create_initial_state(model, moved.q[0], moved.q_dot[0])
        control = series.from_control_names(t, 0.0 * tau, model)
        measured = series.from_names(t, tau, model, self.names)
        return self.sysid.ModelSequences("arm", self.spec, "log", start, control, measured)

    def _rollout(self, moved: Motion) -> Callable[..., Any]:
        """Torques by inverse dynamics, where the toolbox expects a simulation."""
        t, series = moved.rows.t, self.sysid.TimeSeries

        def rollout(models: Any, initial_states: Any, control_signal: Any, param_dicts: Any, **maps: Any) -> list[Any]:
            trajectories: list[Any] = []
            for each in zip(models, param_dicts, initial_states, control_signal, strict=True):
                model, parameters, start, control = each
                sensors = series(t, self._torques(model, parameters, moved), maps["rollout_signal_mapping"])
                states = np.column_stack([t, np.tile(start[1:], (len(t), 1))])  # the first state is the time
                states = series(t, states, maps["rollout_state_mapping"])
                trajectories.append(self.sysid.SystemTrajectory(model, control, sensors, start, states))
            return trajectories

        return rollout
