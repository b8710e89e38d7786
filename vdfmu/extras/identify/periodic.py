"""Periodic torques that reveal the springs from the motor side, and the spectra of a log of them.

At each of two levels of torque there are three realisations, which are multisines of all joints at once with different
random phases. Each consists of a settling period, in which transients decay, and three used periods, whose mean is the
response and whose scatter is the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import correlate

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.motor_side import Complex

LEVELS = (2.5, 5.0)
"""RMS of the torques relative to the breakaway friction f_s: above twice, friction no longer hides the springs."""
REALISATIONS, SETTLING, USED = 3, 1, 3
_PERIODS = REALISATIONS * (SETTLING + USED)
"""Number of periods of a realisation."""
PERIOD = 2.0
"""Period [s]; lines are 0.5 Hz apart."""
_FIRST, _ALL = 1.0, 40.0
"""Lowest line [Hz], and the frequency from which lines are thinned so that each octave has the same number."""
NYQUIST = 0.45
"""Highest line used, as a fraction of a log's rate, which leaves room for the log's filters."""
_PERIODIC = 0.5
"""Smallest correlation of a log's torques with the excitation, to which feedback adds."""
_STOPS = (1.0, 6.0, 36.0)
_PRESLIDING = 3e-6
"""Limits of the stop operators, as multiples of the smallest [rad or m]; bristles of gears bend by 1e-5 to 1e-4."""
_BELLS = (0.4, 1.6)
"""Widths of the bell-shaped terms of falling friction, as multiples of v_s."""
_OVER = 1e-3
"""Time over which speeds are averaged [s]."""


@dataclass(frozen=True, eq=False)
class PeriodicTorques:
    """Torques to add to the motor torques at one pose."""

    t: Floats
    """Times (m,) [s] of whole periods, one after the other."""
    torque: Floats
    """Torques (m, n) [N.m], motor-side, without gravity."""
    levels: int = len(LEVELS)

    @property
    def period(self) -> float:
        """[s]."""
        step = (self.t[-1] - self.t[0]) / (len(self.t) - 1)
        return step * len(self.t) / (self.levels * _PERIODS)

    @property
    def lines(self) -> Floats:
        """Frequencies (f,) [Hz] at which at least one motor is excited."""
        period = self.torque[: round(len(self.t) / (self.levels * _PERIODS))]
        size = np.abs(np.fft.rfft(period, axis=0)).sum(axis=1)
        return np.flatnonzero(size > 1e-3 * size.max()) / self.period


def excitation(rms: Floats, highest: float, step: float, seed: int) -> PeriodicTorques:
    """Return multisines up to a frequency [Hz], with RMS torques (levels, n) [N.m, motor-side], in rows of `step` [s].

    Amplitudes of all lines are equal. `step` is a part of `PERIOD`.
    """
    dice = np.random.default_rng(seed)
    rows = round(PERIOD / step)
    places = np.arange(round(_FIRST * PERIOD), int(highest * PERIOD) + 1)
    places = places[dice.random(len(places)) < _ALL * PERIOD / places]
    parts: list[Floats] = []
    for level in rms:
        for _ in range(REALISATIONS):
            spectrum = np.zeros((rows // 2 + 1, rms.shape[1]), complex)
            spectrum[places] = np.exp(2j * np.pi * dice.uniform(size=(len(places), rms.shape[1])))
            wave = np.fft.irfft(spectrum, rows, axis=0)
            parts += [level / wave.std(axis=0) * wave] * (SETTLING + USED)
    torque = np.concatenate(parts)
    t: Any = np.arange(len(torque)) * step
    return PeriodicTorques(t, torque, len(rms))


class Periods(NamedTuple):
    """A level of a log: spectra of r realisations at f lines, with the variances of their means."""

    f: Floats
    """(f,) [Hz]."""
    torque: Complex
    """ell tau, link-side, (r, f, n)."""
    kappa: Complex
    torque_noise: Floats
    kappa_noise: Floats
    """Variances of the means over the used periods, from their scatter, (f, n)."""
    friction: Complex
    """Regressors of dry friction, (r, f, n, b)."""
    swing: Floats
    """RMS of the torques, motor-side, (n,) [N.m]."""


def aligned(log: Log, plan: PeriodicTorques) -> int:
    """Return the row of a log at which an excitation begins. UsageError if the log does not contain it."""
    rate = round(plan.period / log.step)
    if abs(rate * log.step / plan.period - 1.0) > 1e-3:
        raise UsageError(
            f"{log.where}: expected a step that divides the period of {plan.period:g} s, got {log.step:g} s."
        )
    t = np.arange(0.0, plan.t[-1], log.step)
    played = np.stack([np.interp(t, plan.t, column) for column in plan.torque.T], axis=1)
    if len(log.t) < len(t):
        raise UsageError(
            f"{log.where}: expected a log of the whole excitation, {plan.t[-1]:.4g} s, got "
            f"{log.t[-1] - log.t[0]:.4g} s."
        )
    tau = (log.tau - log.tau.mean(axis=0)) / np.maximum(log.tau.std(axis=0), 1e-300)
    match = sum(
        correlate(a, b, "valid", method="fft")
        for a, b in zip(tau.T, (played / np.maximum(played.std(axis=0), 1e-300)).T, strict=True)
    )
    begin = int(np.argmax(match))
    alike = float(np.max(match)) / len(t) / log.tau.shape[1]
    if alike < _PERIODIC:
        raise UsageError(
            f"{log.where}: expected the torques of the excitation, got others (correlation {alike:.2g}). Check the "
            "order of the joints, and that torques are motor-side."
        )
    return begin


def periods_of(log: Log, plan: PeriodicTorques, robot: Robot, begin: int) -> list[Periods]:
    """Return the spectra of each level of a log whose excitation begins at a row."""
    rows = round(plan.period / log.step)
    places = np.rint(plan.lines * plan.period).astype(int)
    places = places[places < NYQUIST * rows]
    resolution = _resolution(log.kappa)
    levels: list[Periods] = []
    for k in range(plan.levels):
        here = slice(begin + k * _PERIODS * rows, begin + (k + 1) * _PERIODS * rows)
        kappa, tau = log.kappa[here], log.tau[here] * robot.ell
        if len(kappa) < _PERIODS * rows:  # the last row of a log may belong to the last step
            kappa, tau = (np.concatenate([each, each[-1:]])[: _PERIODS * rows] for each in (kappa, tau))

        def spectra(signal: Floats) -> Complex:
            each = signal.reshape(REALISATIONS, SETTLING + USED, rows, -1)[:, SETTLING:]
            return np.fft.rfft(each, axis=2)[:, :, places] / rows

        both = spectra(tau), spectra(kappa)
        noise = [each.var(axis=1, ddof=1).mean(axis=0) / USED for each in both]
        floor = resolution**2 / 12.0 / rows / USED
        bases = [spectra(each).mean(axis=1) for each in _friction(kappa, log.step, resolution, robot.v_s)]
        levels.append(Periods(
            places / plan.period, both[0].mean(axis=1), both[1].mean(axis=1), noise[0], np.maximum(noise[1], floor),
            np.stack(bases, axis=-1), tau.std(axis=0) / robot.ell,
        ))  # fmt: skip
    return levels


def _resolution(kappa: Floats) -> Floats:
    """Return the steps (n,) of encoders, or the smallest changes of positions."""
    smallest = np.zeros(kappa.shape[1])
    for i, column in enumerate(kappa.T):
        apart: Any = np.diff(np.unique(column))
        if len(apart):
            smallest[i] = np.quantile(apart, 0.1)
    return smallest


def _friction(kappa: Floats, step: float, resolution: Floats, fall: Floats) -> list[Floats]:
    """Return terms of the dry friction over motions (m, n): stop operators, and bell-shaped terms of falling friction.

    The stop operator follows the position between two limits, like bristles (Brokate and Sprekels 1996); Coulomb
    friction has a small limit. The terms are calculated from measured positions, so they need no simulation.
    """
    reach = np.array(_STOPS)[:, None] * np.maximum(_PRESLIDING, resolution)
    change = np.diff(kappa, axis=0, prepend=kappa[:1])
    states: Any = np.zeros((len(kappa), *reach.shape))
    z = np.zeros_like(reach)
    for state, dx in zip(states, change, strict=True):
        z = np.clip(z + dx, -reach, reach)
        state[:] = z
    states /= reach
    half = max(1, round(_OVER / step))
    v = np.zeros_like(kappa)
    v[half:-half] = (kappa[2 * half :] - kappa[: -2 * half]) / (2.0 * half * step)
    bells = [np.exp(-((v / (width * fall)) ** 2)) * states[:, 1] for width in _BELLS]
    return [*np.moveaxis(states, 1, 0), *bells]
