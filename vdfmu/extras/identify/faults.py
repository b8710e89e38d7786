"""Faults of logs: clocks, gaps, wrapped angles, columns in another order, other signs and units.

Definite faults are problems. Faults with an unambiguous correction are corrected and noted. Likely faults of ratios,
time and torques are checks in the verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_TYPES, LARGEST_NUMBER, number, unit_of
from vdfmu.base.text import amount
from vdfmu.engine.results.verdict import FAILED, GOOD, Check
from vdfmu.extras.identify.problem import regressor
from vdfmu.study.limits import LIMITS

_UNEVEN = 0.01
"""Largest relative difference of a time step from the median for which rows are used without resampling."""
_POWER = 0.999
"""Share of a velocity's power that is considered."""
_BRIDGED = (384.0 * 1e-4) ** 0.25 / (2.0 * np.pi)
"""Gap, in periods of the fastest motion, over which a cubic spline is accurate to 1e-4 of the amplitude: (omega g)^4 /
384."""
_ROUGHER = 1.2
"""Roughness relative to evenly spaced rows beyond which positions show that the clock is wrong."""
_CERTAIN = 0.4
"""Fraction of a turn from row to row below which the direction is certain."""
_ALIKE, _OFF = 0.1, 0.05
"""Relative difference up to which a ratio counts as a known one, and beyond which it is noted."""
_FOLLOWS = 0.95
"""Correlation between the steps of a link and its rotor below which the link does not follow the rotor."""
_DEVIATIONS = 10.0
"""Standard deviations of the work below which its sign is uncertain: five, doubled because four successive rows are
alike."""
_FEWEST_ROWS = 3
"""Smallest number of rows for a correlation."""
_ROWS = 1000
"""Largest number of rows at which torques are compared with the motion."""
_ALMOST = float(np.log(4.0))
"""Largest log ratio of torques to the expected ones for which they count as equal."""
_BETTER = 0.9
"""Ratio of the torques' residual power below which another unit of the positions fits better."""
_FEWER = 0.25
"""Residual power, relative to that with its own joint, below which a torque fits another joint better."""


class LogColumn(NamedTuple):
    """Values at times [s], and their unit, empty if the file does not have it."""

    t: Floats
    values: Floats
    unit: str


def unwrapped(name: str, values: Floats, periods: Sequence[float], notes: list[str], problems: list[str]) -> Floats:
    """Return unwrapped angles [rad] if wrapped: all within one of `periods`, with steps of more than half of it."""
    for period in periods:
        jumps = np.flatnonzero(np.abs(np.diff(values)) > 0.5 * period)
        if not jumps.size or np.ptp(values) > 1.001 * period:
            continue
        whole: Floats = np.unwrap(values, period=period)
        text = f"{name}: wrapped {jumps.size} times, first in row {jumps[0] + 2}"
        if np.abs(np.diff(whole)).max() > _CERTAIN * period:
            problems.append(
                f"{text}: expected less than {_CERTAIN} turns between rows. Log faster, or log unwrapped angles"
            )
        else:
            notes.append(f"{text}: unwrapped with a period of {period:.6g} rad")
        return whole
    return values


@np.errstate(invalid="ignore")  # infinite times are named as problems: numpy would warn of their differences too
def even_times(
    logged: Mapping[str, Sequence[LogColumn | None]], fewest: int, notes: list[str], problems: list[str]
) -> tuple[Floats, dict[str, Floats]]:
    """Return evenly spaced times (m,) and the quantities (m, n) then, by cubic splines if the log's times differ.

    If there are problems, the quantities are returned as logged, or not at all if they differ in length.
    """
    columns = {f"{key}[{i + 1}]": c for key, each in logged.items() for i, c in enumerate(each) if c is not None}
    clocks: dict[int, tuple[str, LogColumn]] = {}
    for name, column in columns.items():
        clocks.setdefault(id(column.t), (name, column))
        _check_values(name, column.t, column.values, problems)
    t = next(iter(clocks.values()))[1].t
    if len(t) < fewest:
        problems.append(f"{len(t)} rows: expected at least {fewest}")
    whole = len(problems)
    for name, column in clocks.values():
        back = np.flatnonzero(~(np.diff(column.t) > 0.0))
        if back.size:
            i = int(back[0])
            problems.append(
                f"{name}, row {i + 2}: time: expected a finite number, more than the {column.t[i]:.9g} s of the row "
                f"before, got {column.t[i + 1]:.9g} s ({amount(back.size, 'such row')}). Sort the log, or cut it there"
            )
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if len(t) > 1 and step < 0.5 * (t[-1] - t[0]) / (len(t) - 1):  # rows that came in bursts
        step = float(t[-1] - t[0]) / (len(t) - 1)
    if step >= 1.0:
        problems.append(f"expected a row every few ms, got one every {step:g} s: give the unit, --time 'time [ms]'")
    apart = any(not np.array_equal(column.t, t) for _, column in clocks.values())
    uneven = apart or bool(np.any(np.abs(np.diff(t) - step) > _UNEVEN * step))
    if uneven and len(problems) == whole and min(len(c.t) for c in columns.values()) >= fewest:
        _check_gaps(columns, clocks, step, problems)
    if uneven and not problems:
        true = {key: _true_times(column.t, columns, notes, problems) for key, (_, column) in clocks.items()}
        steps = np.concatenate([np.diff(column.t) for _, column in clocks.values()])
        step = float(np.median(np.diff(true[id(t)])))
        low, high = max(each[0] for each in true.values()), min(each[-1] for each in true.values())
        t = low + step * np.arange(int((high - low) / step * (1.0 + 1e-12)) + 1)
        notes.append(
            f"{'columns have different times' if apart else 'times are uneven'}, steps of {1e3 * steps.min():.4g} "
            f"to {1e3 * steps.max():.4g} ms, {np.count_nonzero(steps > 1.5 * step)} gaps: resampled every "
            f"{1e3 * step:.6g} ms by cubic splines"
        )
        columns = {n: LogColumn(t, CubicSpline(true[id(c.t)], c.values)(t), "") for n, c in columns.items()}
    if any(len(column.values) != len(t) for column in columns.values()):
        return t, {}
    none = LogColumn(t, np.full(len(t), np.nan), "")
    return t, {
        key: np.column_stack([columns.get(f"{key}[{i + 1}]", none).values for i in range(len(each))])
        for key, each in logged.items()
    }


def _check_values(name: str, t: Floats, values: Floats, problems: list[str]) -> None:
    bad = np.flatnonzero(~(np.abs(values) < LARGEST_NUMBER))
    if bad.size:
        i = int(bad[0])
        problems.append(
            f"{name}, row {i + 1}, {t[i]:g} s: expected a finite number, got {values[i]}, and {bad.size - 1} more. Cut "
            "the log there, or name another column"
        )


def _check_gaps(
    columns: Mapping[str, LogColumn], clocks: Mapping[int, tuple[str, LogColumn]], step: float, problems: list[str]
) -> None:
    """Note gaps over which a spline would not follow the motion."""
    moving = [c for name, c in columns.items() if name[:5] in ("kappa", "theta")]
    rates = [(np.diff(c.values), np.diff(c.values) / np.diff(c.t)) for c in moving]  # by rows, as a clock may jitter
    highest = max(min(map(fastest, each)) / len(each[0]) for each in rates) / step
    for name, column in clocks.values():
        far = np.flatnonzero(np.diff(column.t) > max(_BRIDGED / highest, 1.5 * step))
        if far.size:
            i = int(far[0])
            problems.append(
                f"{name}, row {i + 1}: expected a row every {step:.4g} s; from {column.t[i]:g} s to "
                f"{column.t[i + 1]:g} s there is a gap, and {far.size - 1} more. A spline follows a motion "
                f"of {highest:.3g} Hz over at most {_BRIDGED / highest:.3g} s: cut the log there, or, if its clock "
                "jitters, average some rows"
            )


def fastest(rate: Floats) -> int:
    """Return the number of periods per log below which a velocity has 99.9 % of its power, without position noise."""
    power = np.abs(np.fft.rfft(rate * np.hanning(len(rate)))) ** 2  # a log may begin and end while the arm moves
    noise = np.sin(np.pi * np.arange(len(power)) / len(rate)) ** 2  # the spectrum of differences of white noise
    top = slice(len(power) // 2, None)  # where there is no motion
    power[power < 10.0 * noise * np.median(power[top] / noise[top])] = 0.0
    power = np.cumsum(power)
    return max(int(np.searchsorted(power, _POWER * power[-1])), 1)


def _true_times(t: Floats, columns: Mapping[str, LogColumn], notes: list[str], problems: list[str]) -> Floats:
    """Return times, or the evenly spaced times around which they jitter if positions are smoother at these."""
    positions = [c.values for name, c in columns.items() if c.t is t and name[:3] != "tau"]
    if not positions:
        return t
    rough = sum(_roughness(t, x) for x in positions)
    fits: list[tuple[float, float, float, Floats]] = []
    for shortest in (np.median(np.diff(t)), np.inf):  # with and without missing rows
        count = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(t) / shortest), 1.0))])
        slope, start = np.polyfit(count, t, 1)
        even: Floats = start + slope * count
        fits.append((sum(_roughness(even, x) for x in positions), slope, float(np.abs(t - even).max()), even))
    smooth, step, most, even = min(fits, key=lambda each: each[0])
    if rough <= _ROUGHER * smooth:
        return t
    if most > 0.5 * step:
        problems.append(
            f"the clock jitters by up to {1e3 * most:.3g} ms, and the motion is smoother without it: expected less "
            f"than half of the {1e3 * step:.3g} ms from row to row. Log the time of the sample, not of its arrival"
        )
    notes.append(
        f"the clock jitters by up to {1e3 * most:.3g} ms, but the motion is {rough / max(smooth, 1e-300):.2g} times as "
        f"smooth with a row every {1e3 * step:.6g} ms, so this even spacing is used"
    )
    return even


def _roughness(t: Floats, x: Floats) -> float:
    """RMS deviation of samples from the cubic through two neighbours on either side, divided by their span."""
    near = [t[k : len(t) - 4 + k] for k in (0, 1, 3, 4)]
    middle, left = t[2:-2], x[2:-2].copy()
    for k, a in zip((0, 1, 3, 4), near, strict=True):
        weight = np.prod([(middle - b) / (a - b) for b in near if b is not a], axis=0)
        left -= weight * x[k : len(x) - 4 + k]
    return float(np.sqrt(np.mean(left**2)) / max(np.ptp(x), 1e-300))


def check_motion(
    t: Floats, arrays: Mapping[str, Floats], robot: Robot, notes: list[str], problems: list[str]
) -> list[Check]:
    """Compare links with rotors, and both with the limits of the robot; joints without encoder become NaN.

    Return checks of implausible speeds and ratios.
    """
    checks = [] if problems else _too_fast(t, arrays["kappa"], robot)
    kappa, q, tau = arrays["kappa"], arrays.get("q"), arrays["tau"]
    moved = np.ptp(kappa, axis=0) != 0.0
    problems += [
        f"tau[{i + 1}]: expected a measured torque, got {tau[0, i] + 0.0:g} N.m in all rows"
        for i in np.flatnonzero(np.ptp(tau, axis=0) == 0.0)
    ]
    for name in ("kappa", "q") if robot.limits else ():
        most = np.asarray(robot.q_max) - np.asarray(robot.q_min)
        span = np.ptp(arrays.get(name, kappa), axis=0)
        problems += [
            f"{name}[{i + 1}]: expected a range below {most[i]:.4g}, the distance of the robot's end stops, got "
            f"{span[i]:.4g}: are these degrees? Give the unit, --column '{name}[{i + 1}]=NAME [deg]'"
            for i in np.flatnonzero(span > 1.05 * most)
            if name in arrays
        ]
    if q is None:
        return checks
    if (still := np.flatnonzero(moved & (np.ptp(q, axis=0) == 0.0))).size:
        named = ", ".join(f"q[{i + 1}]" for i in still)
        notes.append(
            f"{named}: the same in all rows, while the rotors move: treated as without an encoder behind the gear"
        )
        q[:, still] = np.nan
    both = np.flatnonzero(np.isfinite(q).any(axis=0) & moved)
    stride = max(1, len(q) // 1000)
    rows = np.flatnonzero(np.isfinite(q[:, both]).all(axis=1) & np.isfinite(kappa).all(axis=1))[::stride]
    if len(rows) < _FEWEST_ROWS:  # a separate problem
        return checks
    rates = {name: np.diff(each[rows][:, both], axis=0) for name, each in (("q", q), ("kappa", kappa))}
    size = {name: np.sqrt((each**2).mean(axis=0)) for name, each in rates.items()}
    alike = (rates["q"].T @ rates["kappa"]) / len(rates["q"]) / np.outer(size["q"], size["kappa"])
    best = linear_sum_assignment(-np.abs(np.nan_to_num(alike)))[1] if len(both) else []
    for a, (i, b) in enumerate(zip(both, best, strict=True)):
        follows, other, ell = abs(alike[a, a]), abs(alike[a, b]), robot.ell[i]
        if follows < _FOLLOWS < other and a != b:
            problems.append(
                f"q[{i + 1}] moves with kappa[{both[b] + 1}], correlation {alike[a, b]:.3f}, and not with "
                f"kappa[{i + 1}], {alike[a, a]:.3f}: the columns are in another order: use --column 'q[{i + 1}]=NAME'"
            )
            continue
        slope = float(alike[a, a] * size["q"][a] / size["kappa"][a])
        causes = {
            -1.0: f"a sign differs: --column 'q[{i + 1}]=NAME [-1 rad]'",
            np.pi / 180.0: f"the rotor positions look like degrees: --column 'kappa[{i + 1}]=NAME [deg]'",
            180.0 / np.pi: f"the link positions look like degrees: --column 'q[{i + 1}]=NAME [deg]'",
            1.0 / ell: "the rotor positions do not look divided by the gear ratio: --column theta=NAME{}",
            ell: "the link positions look like those of the motor",
        }
        fitting = [text for k, text in causes.items() if abs(slope / k - 1.0) < _ALIKE < abs(k - 1.0)]
        if fitting and follows > _FOLLOWS:
            problems.append(f"q[{i + 1}] moves {slope:.4g} times as far as kappa[{i + 1}], expected 1: {fitting[0]}")
        elif abs(slope - 1.0) > _OFF:
            places = {"place": f"joint {i + 1}", "factor": f"{slope:.3g}", "ratio": f"{ell / slope:.3g}"}
            checks.append(LIMITS["ratio"].check(abs(slope - 1.0), ell=f"{ell:.3g}", **places))
    return checks


def _too_fast(t: Floats, kappa: Floats, robot: Robot) -> list[Check]:
    """Return the check of the joint that moves faster than joints of arms do, if there is one."""
    speed = np.abs(np.gradient(kappa, t, axis=0)).max(axis=0)
    most = np.array([JOINT_TYPES[kind].fastest for kind in robot.joint_types])
    i = int(np.argmax(speed / most))
    unit = unit_of("velocity", robot.joint_types[i])
    row = LIMITS["speed"]._replace(value=float(most[i]), unit=unit)
    check = row.check(float(speed[i]), "such as seconds that were read as milliseconds", place=f"joint {i + 1}")
    return [] if check.state == GOOD else [check]


class _Compared(NamedTuple):
    """Comparison of torques with a motion, through five terms per joint.

    The terms are constant, acceleration, velocity, its sign, and the torque of the robot file's links.
    """

    left: Floats
    """Residual power of torque i with the motion of joint j, relative to the torque's own: (n, n), row i, column j."""
    drives: npt.NDArray[np.bool_]
    """Whether the friction of a joint would drive it, (n,)."""
    ratio: float
    """Size of the torques relative to those of the robot file."""


def _compared(t: Floats, kappa: Floats, tau: Floats, robot: Robot) -> _Compared:
    h, n = float(t[1] - t[0]), robot.n
    moved = np.flatnonzero(np.ptp(kappa, axis=0) > 0.0)
    highest = max(fastest(np.diff(kappa[:, i])) for i in moved) / (h * len(t)) if len(moved) else 0.0
    width = max(1, min(int(0.05 / (highest * h)), len(t) // 200)) if highest else 1
    m = len(t) // width
    kappa, tau = (each[: m * width].reshape(m, width, n).mean(axis=1) for each in (kappa, tau * robot.ell))
    v = np.gradient(kappa, h * width, axis=0)
    a = np.gradient(v, h * width, axis=0)
    kappa, tau, v, a = (each[:: -(-m // _ROWS)] for each in (kappa, tau, v, a))
    links = regressor(robot, kappa, v, a, v, a).links @ body_parameters(robot)
    model = links + robot.I_m * robot.ell * a
    left, drives = np.ones((n, n)), np.zeros(n, bool)
    for j in moved:
        X = np.column_stack([np.ones(len(a)), a[:, j], v[:, j], np.tanh(v[:, j] / (0.05 * v[:, j].std())), links[:, j]])
        X = X / np.maximum(np.abs(X).max(axis=0), 1e-300)
        c: Any = np.linalg.lstsq(X, tau, rcond=None)[0]
        rest = ((tau - X @ c) ** 2).mean(axis=0)
        left[:, j] = rest / np.maximum(tau.var(axis=0), 1e-300)
        weight = (X[:, 2:4] * v[:, j, None]).mean(axis=0)  # the work of friction is weight @ c[2:4]
        deviation = np.sqrt(rest[j] * weight @ np.linalg.pinv(X.T @ X)[2:4, 2:4] @ weight)
        drives[j] = weight @ c[2:4, j] < -_DEVIATIONS * deviation and tau[:, j] @ v[:, j] < 0.0
    whole = (model[:, moved] ** 2).mean(axis=0)
    ratios = np.sqrt((tau[:, moved] ** 2).mean(axis=0) / np.maximum(whole, 1e-300))
    return _Compared(left, drives, float(np.median(ratios)) if len(moved) else 1.0)


def check_torques(t: Floats, arrays: Mapping[str, Floats], robot: Robot, checks: Sequence[Check]) -> list[Check]:
    """Return the checks of a log with `checks` of its motion, and those of its torques.

    Torques may fit another joint, have another size, or show friction that would drive its joint. If they fit a motion
    in degrees, that is the only check, because it also explains wrong speeds and torques.
    """
    kappa, tau = arrays["kappa"], arrays["tau"]
    read = _compared(t, kappa, tau, robot)
    degrees = kappa * np.where([JOINT_TYPES[kind].slides for kind in robot.joint_types], 1.0, np.pi / 180.0)
    meant = _compared(t, degrees, tau, robot)
    moved = np.flatnonzero(np.ptp(kappa, axis=0) > 0.0)
    left, left_then = (float(np.diag(each.left)[moved].sum()) for each in (read, meant))
    slower = bool(_too_fast(t, kappa, robot)) and not _too_fast(t, degrees, robot)
    off, off_then = (abs(np.log(max(each.ratio, 1e-300))) for each in (read, meant))
    if off_then < _ALMOST < off and (slower or left_then < _BETTER * left):
        columns = " ".join(f"--column '{name}=NAME{{}} [deg]'" for name in ("kappa", "q") if name in arrays)
        text = "the positions look like degrees that were read as rad"
        return [Check("degrees", "Unit of the positions", FAILED, text, f"use {columns}")]
    return [*checks, *_torque_checks(read, moved, robot)]


def _torque_checks(read: _Compared, moved: npt.NDArray[np.intp], robot: Robot) -> list[Check]:
    """Return checks of torques that fit another joint, have driving friction, or have another size."""
    left, drives, ratio = read
    checks: list[Check] = []
    best = linear_sum_assignment(np.log(left[np.ix_(moved, moved)] + 1e-9))[1] if len(moved) else []
    for i, j in zip(moved, moved[best], strict=True):
        if left[i, j] < _FEWER * left[i, i]:
            more = (
                f"that motion explains all but {100 * left[i, j] ** 0.5:.0f} % of it, the motion of joint {i + 1} all "
                f"but {100 * left[i, i] ** 0.5:.0f} %: check the order of the columns"
            )
            text = f"tau[{i + 1}] fits joint {j + 1} better than its own"
            checks.append(Check("order", "Order of the columns", FAILED, text, more))
        elif drives[i]:
            text = f"tau[{i + 1}] has the opposite sign: its friction would drive the joint"
            checks.append(Check("sign", "Sign", FAILED, text, f"use --column 'tau[{i + 1}]=NAME [-1 N.m]'"))
    if not len(moved):
        return checks
    ell = float(np.median(robot.ell[moved]))
    causes = {
        1e3: ("mN.m were read as N.m", "use --column 'tau=NAME{} [mN.m]'"),
        1e-3: ("kN.m were read as N.m", "use --column 'tau=NAME{} [kN.m]'"),
        ell: ("they are link-side", "use --column tau_link=NAME{}"),
        1.0 / ell: ("they are motor-side", "use --column tau=NAME{}"),
    }
    nearest = min(causes, key=lambda factor: abs(np.log(max(ratio, 1e-300) / factor)))
    cause, way = causes[nearest] if _ALMOST > abs(np.log(max(ratio, 1e-300) / nearest)) else ("check the unit", "")
    check = LIMITS["torque"].check(max(ratio, 1.0 / max(ratio, 1e-300)), way, factor=number(ratio, 2), cause=cause)
    return checks if check.state == GOOD else [check, *checks]
