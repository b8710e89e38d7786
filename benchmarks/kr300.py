"""A measured arm identified in several ways from one log, and what each leaves of the torques of another log."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from benchmarks.engines import mujoco_spec
from benchmarks.report import Report, Table
from benchmarks.timing import processor_time
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
COUNTERBALANCES = ("no counterbalance", "a spring for it", "its law given")
"""What MuJoCo has in place of the gas spring: nothing; a linear spring between the two pivots, of which stiffness and
free length are fitted; or the torque of the robot file's law, applied from outside, of which the size is fitted, except
in simulations."""
REGRESSIONS = ("ordinary least squares", "weighted least squares", f"weighted, robot file within {100 * PRIOR:.0f} %")
"""Of a rigid arm; weighted, each axis is divided by what the first solution leaves of it. In the last, errors of the
robot file are the unknowns, of the size that vdfmu takes for them."""
ITERATIONS = 20
"""Of the toolbox, at most; the sum of squares falls by less than 3e-3 of itself in twenty more."""
PIECE = 0.5
"""Length of the pieces of the log that MuJoCo simulates from their measured start on [s]."""
_DEPENDENT = 1e-8
"""Singular value, over the largest, of combinations of parameters that move no torque."""
_WIDE = 10.0
"""Factor by which the toolbox may leave the robot file's friction, rotors and springs, as its default is of masses."""
_NEAR = {"armature": 1.0 + PRIOR, "balance": 1.0 + PRIOR}
"""The same, if the robot file is near, as vdfmu takes it to be; of all else 2."""


class Fit(NamedTuple):
    """One way to identify, and what it leaves."""

    method: str
    parameters: int
    """Numbers that were fitted; of a regression the rank of its matrix."""
    seconds: float | None
    """Processor time [s]."""
    residuals: list[Floats]
    """Residual torques on the fitted log and on the other, root mean squares (n,) over those of the torques."""


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
    """Identify from one log in all ways, and show the residuals of both."""
    folder = data_path("examples") / "kr300"
    robot = load_robot(folder / "nominal.toml")
    logs = [read_log(folder / f"{name}.parquet", robot) for name in "ab"]
    fits = study(robot, logs[0], logs[1], report.say, 2 if quick else ITERATIONS)
    axes = [(f"{i + 1}", ".1f") for i in range(robot.n)]
    for k, text in enumerate(("on A, to which they were fitted", "on B, to which they were not")):
        table = Table(
            f"kr300_{'ab'[k]}", f"Residual torque {text}, % of each axis's",
            [("method", ""), *axes, ("parameters", "d"), ("processor time [s]", ".2f")],
        )  # fmt: skip
        for fit in fits:
            table.add(fit.method, *100.0 * fit.residuals[k], fit.parameters, fit.seconds)
        report.show(table)


def study(robot: Robot, fitted: Log, other: Log, say: Callable[[str], None], iterations: int) -> list[Fit]:
    """Fit each model to one log; MuJoCo's toolbox in so many iterations at most."""
    fits: list[Fit] = []
    scores: list[LogScore] = []
    for text, prior in ((f"robot file within {100 * PRIOR:.0f} %", PRIOR), ("links unknown", np.inf)):
        began = processor_time()
        model = identify(fitted, robot, prior=prior)
        spent = processor_time() - began
        scores = [score(model, robot, fitted, log) for log in (fitted, other)]
        count = sum(name not in model.held for name in model.names)
        fits.append(Fit(f"vdfmu, elastic, {text}", count, spent, [each.torque_left / each.torque for each in scores]))
    motions = [motion(robot, log, each.rows) for log, each in zip((fitted, other), scores, strict=True)]
    fits += [_regression(robot, motions, each) for each in REGRESSIONS]
    fits.append(Fit("five terms an axis", 5 * robot.n, None, [each.rigid_left / each.torque for each in scores]))
    if (sysid := toolbox()) is None:
        say("without MuJoCo's toolbox, which is not installed (pip install 'mujoco[sysid]>=4')")
        return fits
    ways = [(balance, False, False) for balance in (COUNTERBALANCES if robot.counterbalance else COUNTERBALANCES[:1])]
    for balance, near, simulated in [*ways, (ways[-1][0], True, False), (ways[-1][0], False, True)]:
        fits.append(_Arm(sysid, robot, balance, near, simulated).fit(motions, iterations))
        say(f"{fits[-1].method}: {fits[-1].seconds:.0f} s of processor time")
    return fits


def _regression(robot: Robot, motions: Sequence[Motion], method: str) -> Fit:
    """Least squares of a rigid arm, in whose parameters torques are linear (Gautier and Khalil 1990; Gautier 1997)."""
    began = processor_time()
    base = base_parameters(robot)
    tables = [_columns(robot, base.columns, moved) for moved in motions]
    torques = [moved.rows.problem.tau for moved in motions]
    drives = [robot.I_m * robot.ell, robot.f_c, robot.f_v, robot.F_cb, robot.ell]
    file = np.concatenate([base.matrix @ body_parameters(robot), *drives[:4], 0.0 * robot.ell])
    shares = (0.2, 1.0, 1.0, 0.2, 1.0)  # as vdfmu's; of the constant 1 N.m of the motor
    drive_errors = np.diag(np.concatenate([share * each for share, each in zip(shares, drives, strict=True)]))
    link_errors: Any = link_covariance(robot, base, PRIOR)
    errors: Any = block_diag(np.linalg.cholesky(link_errors), drive_errors)
    x, rank, weights = file, 0, np.ones(robot.n)
    for _ in range(1 if method == REGRESSIONS[0] else 2):
        A = (tables[0] * weights[:, None]).reshape(-1, len(x)) @ errors
        b = ((torques[0] - tables[0] @ file) * weights).ravel()
        rank = np.linalg.matrix_rank(A, rtol=_DEPENDENT)
        if method == REGRESSIONS[2] and weights[0] != 1.0:
            A, b = np.vstack([A, np.eye(len(x))]), np.append(b, 0.0 * x)
        x = file + errors @ np.linalg.lstsq(A, b, rcond=_DEPENDENT)[0]
        weights = 1.0 / rms(torques[0] - tables[0] @ x)
    spent = processor_time() - began
    residuals = [rms(tau - table @ x) / rms(tau) for tau, table in zip(torques, tables, strict=True)]
    return Fit(f"rigid, {method}", int(rank), spent, residuals)


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


def rigid_spec(robot: Robot, balance: str = COUNTERBALANCES[0]) -> Any:
    """Return the rigid arm for MuJoCo, with rotors as armature, Coulomb and viscous friction of the robot file."""
    mujoco: Any = import_module("mujoco")
    spec = mujoco_spec(robot)
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for i in range(robot.n):
        joint = spec.joint(f"link{i}")
        joint.armature = float(robot.I_m[i] * robot.ell[i])
        joint.damping, joint.frictionloss = [float(robot.f_v[i]), 0.0, 0.0], float(robot.f_c[i])
        spec.add_actuator(name=f"motor{i}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if balance == COUNTERBALANCES[1] and robot.F_cb[i] > 0.0:
            D, r, angle = robot.D_cb[i], robot.r_cb[i], robot.delta_cb[i]
            before = spec.body(f"body{i - 1}") if i else spec.worldbody
            before.add_site(name=f"pivot{i}", pos=robot.offset[i] + robot.rotation[i] @ [D, 0.0, 0.0])
            spec.body(f"body{i}").add_site(name=f"crank{i}", pos=[r * np.cos(angle), r * np.sin(angle), 0.0])
            stiffness = robot.F_cb[i] / robot.L_cb[i]  # of the gas at dead centre
            short = D - r - robot.L_cb[i]
            tendon = spec.add_tendon(name=f"gas{i}", stiffness=[stiffness, 0.0, 0.0], springlength=[short, short])
            tendon.wrap_site(f"pivot{i}")
            tendon.wrap_site(f"crank{i}")
    return spec


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

    def __init__(self, sysid: Any, robot: Robot, balance: str, near: bool, simulated: bool) -> None:
        mujoco: Any = import_module("mujoco")
        self.sysid, self.robot, self.near, self.simulated = sysid, robot, near, simulated
        self.method = f"MuJoCo, {'positions' if simulated else 'torques'}, {balance}" + near * ", robot file near"
        self.spec = rigid_spec(robot, balance)
        self.models: dict[bytes, Any] = {}
        self.parameters = sysid.ParameterDict()
        # its division by the size of what was measured gives all weight to an axis whose position is near 0
        self.transform = sysid.SignalTransform(normalize=not simulated)
        model = self.spec.compile()
        for i in range(robot.n):
            kind, limits = sysid.InertiaType.Pseudo, self._limits(i) if near else {}
            name, modifier = f"body{i}", self._link(f"body{i}")
            body = sysid.body_inertia_param(self.spec, model, name, inertia_type=kind, modifier=modifier, **limits)
            self.parameters.add(body)
            for attribute in ("armature", "damping", "frictionloss"):
                self._add("joint", f"link{i}", attribute)
            kind = mujoco.mjtSensor.mjSENS_JOINTPOS if simulated else mujoco.mjtSensor.mjSENS_JOINTACTFRC
            self.spec.add_sensor(name=f"link{i}", type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=f"link{i}")
            if not simulated:
                bound = float(robot.ell[i])  # 1 N.m of the motor
                self.parameters.add(sysid.Parameter(f"bias{i}", 0.0, -bound, bound))
                self.transform.bias(f"link{i}", self.parameters[f"bias{i}"], target="predicted")
        for tendon in self.spec.tendons:
            self._add("tendon", tendon.name, "stiffness")
            self._add("tendon", tendon.name, "springlength")
        if balance == COUNTERBALANCES[2]:  # a simulation takes the torque from outside as it is
            self.parameters.add(sysid.Parameter("balance", 1.0, *self._bounds("balance"), frozen=simulated))
        self.names = [sensor.name for sensor in self.spec.sensors]

    def fit(self, motions: Sequence[Motion], iterations: int) -> Fit:
        """Fit to the first motion, and return the residuals of all."""
        began = processor_time()
        fitted = motions[0]
        residual = self.sysid.build_residual_fn(
            models_sequences=[self._pieces(fitted) if self.simulated else self._whole(fitted)],
            build_model=self._model, modify_residual=self.transform.apply, resample_true=False,
            custom_rollout=None if self.simulated else self._rollout(fitted),
        )  # fmt: skip
        lower, upper = self.parameters.get_bounds()
        fitted_values, _ = self.sysid.optimize(
            self.parameters, residual, verbose=False, max_iters=iterations, x_scale=upper - lower, output=io.StringIO()
        )
        spent = processor_time() - began
        bias = np.array([0.0 if self.simulated else fitted_values[f"bias{i}"].value[0] for i in range(self.robot.n)])
        model = self._model(fitted_values, self.spec)
        residuals: list[Floats] = []
        for moved in motions:
            tau = moved.rows.problem.tau
            residuals.append(rms(tau - bias - self._torques(model, fitted_values, moved)) / rms(tau))
        return Fit(self.method, fitted_values.size, spent, residuals)

    def _link(self, name: str) -> Callable[[Any, Any], None]:
        """Write the ten parameters of a body, in a form in which all values are physical."""

        def modify(spec: Any, parameter: Any) -> None:
            self.sysid.apply_body_inertia(spec, name, parameter)
            spec.body(name).iquat = [1.0, 0.0, 0.0, 0.0]  # it leaves NaN, with which MuJoCo 4.0.0 does not compile

        return modify

    def _add(self, kind: str, name: str, attribute: str) -> None:
        """Fit a number of a joint or tendon."""

        def modify(spec: Any, parameter: Any) -> None:
            part = getattr(spec, kind)(name)
            value = np.array(getattr(part, attribute), dtype=float)
            # damping and stiffness are polynomials; a spring has a range of free lengths
            value.flat[: 2 if attribute == "springlength" else 1] = parameter.value[0]
            setattr(part, attribute, value if value.ndim else float(value))

        value = float(np.ravel(getattr(getattr(self.spec, kind)(name), attribute))[0])
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

    def _model(self, parameters: Any, spec: Any) -> Any:
        """Compile the model of some values once, for all pieces of the log."""
        key = parameters.as_vector().tobytes()
        if key not in self.models:
            if len(self.models) > parameters.size:
                self.models.clear()
            self.models[key] = self.sysid.apply_param_modifiers(parameters, spec)
        return self.models[key]

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

    def _pieces(self, moved: Motion) -> Any:
        """Positions in pieces that follow from the measured torques and from the measured start of each."""
        sysid, h = self.sysid, moved.log.step
        self.spec.option.timestep = h
        model, count = self.spec.compile(), round(PIECE / h)
        t = h * np.arange(count + 1)
        tau = moved.log.tau * self.robot.ell + ("balance" in self.parameters) * moved.balance
        weights = 1.0 / np.std(moved.q, axis=0)
        self.transform.set_sensor_weights(dict(zip(self.names, weights, strict=True)))
        pieces = [slice(k, k + count + 1) for k in range(0, len(tau) - count, count)]
        return sysid.ModelSequences(
            "arm", self.spec, [f"{k.start}" for k in pieces],
            [sysid.create_initial_state(model, moved.q[k.start], moved.q_dot[k.start]) for k in pieces],
            [sysid.TimeSeries.from_control_names(t, tau[k], model) for k in pieces],
            [sysid.TimeSeries.from_names(t, moved.q[k], model, self.names) for k in pieces],
        )  # fmt: skip
