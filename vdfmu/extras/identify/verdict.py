"""The verdict on an identification: faults of the log, residuals, and a comparison with two simpler models.

The simpler models are the links of the robot file with fitted friction, and rigid joints with delayed encoders behind
the gears. If the identified model fits no better, the log does not support its parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError
from vdfmu.base.measure import number
from vdfmu.base.text import first_few
from vdfmu.engine.results.verdict import DOUBTFUL, GOOD, STATES, Check, verdict_of
from vdfmu.extras.identify.fit import PRIOR, Identified, LogScore, with_identified_links
from vdfmu.extras.identify.search import NO_START
from vdfmu.study.limits import LIMITS, Limit

_DRAWS = 999
_LEVEL = 0.025
"""Number of bootstrap draws, and the share of them beyond either end of the 95 % interval."""
_AS_GOOD = "the file's links are equally good"


def gain(error: Floats, null: Floats) -> tuple[float, float]:
    """Return the 95 % interval of a model's gain over a simpler one, relative to the latter's mean square.

    `error` and `null` (k,) are their residuals in the same rows. Neighbouring rows are correlated, so blocks of 2
    k^(1/3) rows are drawn together (Kuensch, The jackknife and the bootstrap for general stationary observations,
    1989).
    """
    k = len(error)
    length = min(k, int(np.ceil(2.0 * k ** (1.0 / 3.0))))
    starts = np.random.default_rng(0).integers(0, k - length + 1, (_DRAWS, -(-k // length)))
    sums = [np.concatenate([[0.0], np.cumsum(each**2)]) for each in (error, null)]
    ours, theirs = ((each[starts + length] - each[starts]).sum(axis=1) for each in sums)
    low, high = np.quantile(1.0 - ours / np.maximum(theirs, 1e-300), (_LEVEL, 1.0 - _LEVEL))
    return float(low), float(high)


def verdict(fit: Identified, log_checks: tuple[Check, ...], robot: Robot, score: LogScore) -> dict[str, Any]:
    """Return the entry ``verdict`` of an identification, scored on its own log or on another."""
    absent = [name for name, why in fit.held.items() if why == NO_START]
    advice = f"give {', '.join(first_few(absent))} in the robot file, where they are 0 and so not fitted"
    first = advice if absent else ""
    checks = [
        *log_checks,
        *_scale(fit, robot, score, first),
        *_bodies(fit, robot),
        *_residual(robot, score, first),
        *_links(robot, score),
        *_springs(robot, score),
    ]
    shares = 100.0 * score.torque_left / score.torque
    results = [f"residual torque {shares.min():.3g} to {shares.max():.3g} %"]
    if fit.weak:
        results.append(f"{len(fit.weak)} of {len(fit.names)} parameters weak")
    return verdict_of(checks, results)


def _worst(row: Limit, values: Mapping[str, float], more: str = "") -> Check:
    """Return the check with the worst value."""
    place = max(values, key=lambda name: (STATES.index(row.state(values[name])), values[name]))
    return row.check(values[place], more, place=place)


def _scale(fit: Identified, robot: Robot, score: LogScore, first: str) -> Iterator[Check]:
    """Yield a check of the links' scale, which is wrong if a gear ratio or a torque constant is wrong.

    The scale is the factor by which the torques of the file's links fit those of the identified links best, with each
    joint relative to its total torque. A file that is declared less certain than usual gives no information on the
    scale.
    """
    p = score.rows.problem
    weighted = p.filtered.Y / score.torque[:, None]
    file, identified = (weighted @ x[p.places["links"]] for x in (p.start, fit.x))
    scale = float((file * identified).sum() / max((file**2).sum(), 1e-300))
    if scale <= 0.0 or fit.prior > PRIOR:  # there is no scale without gravity and motion, or if the signs differ
        return
    ell = float(robot.ell[0])
    if first:
        cause = first
    elif np.ptp(robot.ell) > 0.0:
        cause = "check the gear ratios"
    elif any(name in fit.weak for name in fit.base.names):  # they stay near the file's, so the ratio is off by more
        cause = f"check the gear ratio, {ell:.3g}"
    else:
        cause = f"is the gear ratio {ell / scale:.3g}, not {ell:.3g}?"
    more = "or check the torque constant; if the masses of the robot file are guesses, use --prior 0.5"
    check = LIMITS["scale"].check(max(scale, 1.0 / scale), more, factor=number(scale), cause=cause)
    if check.state != GOOD:
        yield check


def _bodies(fit: Identified, robot: Robot) -> Iterator[Check]:
    """Yield a check if the identified parameters are not physically consistent."""
    try:
        if not robot.payload:
            with_identified_links(fit, robot)
    except ModelError as error:
        text = "identified links are physically inconsistent, so the file's are kept"
        yield Check("bodies", "Bodies", DOUBTFUL, text, f"check the gear ratio of each joint; {error}")


def _residual(robot: Robot, score: LogScore, first: str) -> Iterator[Check]:
    shares = dict(zip(_places(robot), (score.torque_left / score.torque).tolist(), strict=True))
    more = f"{first}{', or ' if first else ''}check units, signs and order of the columns, and the robot file"
    check = _worst(LIMITS["residual"], shares, more)
    yield check if check.state != GOOD else check._replace(more="")


def _links(robot: Robot, score: LogScore) -> Iterator[Check]:
    """Yield the check of whether the robot file's links, with fitted friction, are as good as the identified ones."""
    gains = [gain(e, n) for e, n in zip(score.torque_error.T, score.held_error.T, strict=True)]
    better = [place for place, (low, _) in zip(_places(robot), gains, strict=True) if low > 0.0]
    worse = [place for place, (_, high) in zip(_places(robot), gains, strict=True) if high < 0.0]
    if worse:
        text = f"the robot file's links predict the torque better at {_joined(worse)}"
        yield Check("links", "Fitted links", DOUBTFUL, text, "links fitted with --prior 0.001 are better")
    else:
        text = f"fitted links are better than the file's at {_joined(better)}" if better else _AS_GOOD
        yield Check("links", "Fitted links", GOOD, text)


def _springs(robot: Robot, score: LogScore) -> Iterator[Check]:
    """Yield the check of whether rigid joints with a delay explain the deformations as well as the springs."""
    seen = np.flatnonzero(np.isfinite(score.deformation))
    if not len(seen):
        return
    gains = {_places(robot)[i]: gain(score.deformation_error[:, i], score.rigid_deformation[:, i]) for i in seen}
    vain = [place for place, (low, _) in gains.items() if low <= 0.0]
    if vain:
        text = f"a rigid joint with a delay fits as well as the spring at {_joined(vain)}"
        yield Check("springs", "Springs", DOUBTFUL, text, "the log does not determine a stiffness there")
    else:
        yield Check("springs", "Springs", GOOD, "springs explain the deformations better than rigid joints")


def _places(robot: Robot) -> list[str]:
    return [f"joint {i + 1}" for i in range(robot.n)]


def _joined(places: list[str]) -> str:
    numbers = [place.removeprefix("joint ") for place in places]
    return f"joint{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"
