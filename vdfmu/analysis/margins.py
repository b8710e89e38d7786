"""Margins of stability of the sampled loop of an arm: plant linearised along the motion, feedback held over a step.

At each time the plant is linearised where the desired motion has it, discretised exactly for inputs that are held over
a communication step, and closed by ``u[k] = K x[k - d]`` with d samples of delay. Joint i's loop is opened at its motor
while those of all others stay closed: with the loop of all joints ``L(z) = -z^-d K (z - A)^-1 B`` and
``S = (1 + L)^-1`` it is ``L_i = 1 / S_ii - 1``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.analysis.linear import feedback, lively, without_dry_friction
from vdfmu.arrays import Floats
from vdfmu.engine.algorithms import CONTINUOUS
from vdfmu.engine.linear import LinearSystem
from vdfmu.engine.space import Linear, held
from vdfmu.errors import UsageError
from vdfmu.scenario import Scenario
from vdfmu.scenario.values import system_values
from vdfmu.ssp.description import SystemDescription
from vdfmu.study.wired import System
from vdfmu.unit.linear import state_space

Complex = npt.NDArray[np.complex128]

_DESIRED = {
    "q": "trajectory.q_d",
    "q_dot": "trajectory.q_d_dot",
    "kappa_dot": "feedforward.kappa_dot_d",
    "tau_s": "feedforward.tau_s",
}
"""States of the plant to the signals that have them along the desired motion."""
_TIMES = 11
_GRID = 400
"""Frequencies at which a loop is calculated, beside those around its poles."""
_AROUND = np.concatenate([-np.geomspace(8.0, 0.25, 6), [0.0], np.geomspace(0.25, 8.0, 6)])
"""Distances to the frequency of a pole, as shares of its decay rate."""
_SLOWEST = 1e-4
"""Lowest of them, as a share of half the sampling frequency."""
_ROUNDING = 1e-9
"""Of rates over a step, as a share of the state's largest."""


class Margins(NamedTuple):
    """Margins of each joint's loop, (n,) each."""

    modulus: Floats
    """Smallest distance of the loop to -1, min |1 + L|."""
    gain: Floats
    """Smallest factor above 1 of the loop's gain that destabilises it."""
    phase: Floats
    """Smallest lag [rad] that does."""
    delay: Floats
    """Smallest further delay [s] that does."""
    radius: float
    """Largest absolute eigenvalue of the closed loop, but for those of constants; unless it is below 1, or what the
    growth allows, modulus, phase and delay are 0."""


@dataclass(frozen=True)
class Loop:
    """The loop at one time."""

    t: float
    """In s."""
    plant: Linear
    """Continuous, with the motor torques as inputs."""
    K: Floats
    """Feedback (n, n_x): deviation of the motor torques by those of the plant's states."""
    step: float
    """In s."""
    growth: float = 0.0
    """Rate [1/s] up to which what grows counts as stable: margins are those on the circle ``|z| = exp(growth
    step)``."""
    discrete: bool = False
    """Whether the plant is given from one communication point to the next already."""

    @cached_property
    def sampled(self) -> Linear:
        """The plant from one communication point to the next."""
        return self.plant if self.discrete else held(self.plant, self.step)

    @cached_property
    def constants(self) -> int:
        """Number of combinations of states that stay as they are whatever the inputs do.

        At rest hysteresis and bristles are springs, parallel to those of the drives: the states of such springs have
        a common rate. Their pole is 1, and no loop reaches it.
        """
        A, B = self.sampled
        rates = np.hstack([A - np.eye(len(A)), B])
        largest = np.abs(rates).max(axis=1, keepdims=True)
        rank = np.linalg.matrix_rank(rates / np.where(largest > 0.0, largest, 1.0), tol=_ROUNDING)
        return len(A) - int(rank)

    @cached_property
    def grid(self) -> tuple[Floats, Complex]:
        """Frequencies [rad/s], (m,), up to half the sampling frequency, and the response there."""
        w = np.geomspace(_SLOWEST, 1.0, _GRID) * np.pi / self.step
        w = np.union1d(w, self.around(np.linalg.eigvals(self.sampled.A)))
        return w, self.response(w)

    def around(self, poles: Any) -> Floats:
        """Frequencies [rad/s] at and around lightly damped poles, whose peaks a grid would miss."""
        s = np.log(poles[np.abs(poles) > 0.5].astype(complex)) / self.step
        s = s[(s.imag > _SLOWEST * np.pi / self.step)]
        w = s.imag[:, None] + np.abs(s.real - self.growth)[:, None] * _AROUND
        return np.unique(w[(w > 0.0) & (w < np.pi / self.step)])

    def response(self, w: Floats) -> Any:
        """Response of the sampled plant's states to the motor torques at frequencies (m,) [rad/s]: (m, n_x, n)."""
        A, B = self.sampled
        return np.linalg.solve(self.z(w)[:, None, None] * np.eye(len(A)) - A, B.astype(complex))

    def z(self, w: Floats) -> Complex:
        """Points of the circle on which the loop is calculated."""
        return np.exp((self.growth + 1j * w) * self.step)

    def closed(self, K: Floats | None = None, delay: int = 1) -> Floats:
        """Matrix of the closed loop's states from one communication point to the next; K in place of its own."""
        A, B = self.sampled
        K = self.K if K is None else K
        if not delay:
            return A + B @ K
        n, m = B.shape
        size = n + delay * m  # states, then the torques of the coming steps, the next one first
        whole = np.zeros((size, size))
        whole[:n, :n], whole[:n, n : n + m] = A, B
        whole[n : size - m, n + m :] = np.eye(size - m - n)
        whole[size - m :, :n] = K
        return whole

    def margins(self, K: Floats | None = None, delay: int = 1) -> Margins:
        """Margins with feedback K, by default its own."""
        K = self.K if K is None else K
        n = len(K)
        poles = np.linalg.eigvals(self.closed(K, delay))
        poles = poles[np.argsort(np.abs(poles - 1.0))[self.constants :]]
        radius = float(np.abs(poles).max())
        if not radius < np.exp(self.growth * self.step):
            return Margins(np.zeros(n), np.ones(n), np.zeros(n), np.zeros(n), radius)
        w, G = self.grid
        more = np.setdiff1d(self.around(poles), w)
        order = np.argsort(w := np.concatenate([w, more]))
        G = np.concatenate([G, self.response(more)])[order]
        late = self.z(w[order])[:, None, None] ** -delay
        S = np.linalg.inv(np.eye(n) - late * (K @ G))
        modulus, gain, phase, left = _margins(1.0 / np.diagonal(S, axis1=1, axis2=2) - 1.0, w[order])
        return Margins(modulus, gain, phase, left, radius)


class ArmLoops:
    """The loop of a scenario with trajectory, feedforward, controller and plant along its desired motion.

    Without Coulomb and Stribeck friction of the plant, whose slope damps by far more than all else near standstill, and
    takes damping away at slow motion; viscous friction stays.

    Parameters
    ----------
    scenario : Scenario
    settings : mapping, optional
        Changed parameters.
    times : sequence of float, optional
        Default eleven, evenly spread from the start to the end.
    growth : float [1/s]
        Rate up to which what grows counts as stable. A weakly damped mode of the arm may grow slowly at some places of
        a motion that soon passes them.

    Attributes
    ----------
    loops : list of Loop
        One for each time.

    Raises
    ------
    UsageError
        If the system has other units, or feedback with states.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Mapping[str, Any] | None = None,
        *,
        times: Sequence[float] | Floats | None = None,
        growth: float = 0.0,
    ) -> None:
        system = self._system = System(SystemDescription(scenario, system_values(scenario, settings)))
        units, run = system.units, system.python(system.evaluate)
        wanted = [tuple(signal.split(".")) for signal in ("plant.tau", *_DESIRED.values())]
        lacking = [f"{u}.{g}" for u, g in wanted if u not in units or g not in units[u].interface.groups]
        if lacking:
            raise UsageError(
                f"margins: expected a system with trajectory, feedforward and plant; there is no {', '.join(lacking)}."
            )
        system.start()
        system.memory[system.solver_x] = system.memory[system.x]
        plant = units["plant"]
        without_dry_friction(plant)
        table = plant.interface
        self._lively = lively((v.name for v in table.variables[table.states]), dry=False)
        self._x: list[Floats] = []
        self.loops: list[Loop] = []
        for t in np.linspace(0.0, scenario.stop, _TIMES) if times is None else times:
            for _ in range(2):  # the feedforward may see the plant's states
                run(t)
                desired = np.concatenate([units[u].group(g) for u, g in wanted[1:]])
                system.memory[system.solver_x[: desired.size]] = (
                    desired  # those of options stay at their start
                )
            run(t)
            self._x.append(system.memory[system.solver_x])
            found = state_space(plant, ("tau",))
            moving = Linear(found.A[np.ix_(self._lively, self._lively)], found.B[self._lively])
            self.loops.append(Loop(float(t), moving, self._feedback(t), scenario.step, growth))

    def _feedback(self, t: float) -> Floats:
        return feedback(self._system, "plant", ("tau",), t)[:, self._lively]

    def margins(self, values: Mapping[str, float] | None = None, delay: int = 1) -> Margins:
        """Smallest margins of each joint over all times.

        Parameters
        ----------
        values : mapping, optional
            Other parameters of units but the plant, ``component.variable``.
        delay : int
            Samples that the feedback comes late: 0 with ``gauss-seidel``, 1 with ``jacobi`` and most importers.
        """
        system = self._system
        for name, value in (values or {}).items():
            component, _, variable = name.partition(".")
            unit = system.units[component]
            unit.memory[unit.interface.reference[variable]] = value
        each: list[Margins] = []
        for loop, x in zip(self.loops, self._x, strict=True):
            system.memory[system.solver_x] = x
            K = loop.K if values is None else self._feedback(loop.t)
            each.append(loop.margins(K, delay))
        modulus, gain, phase, left = np.min([m[:4] for m in each], axis=0)
        return Margins(modulus, gain, phase, left, max(m.radius for m in each))


def system_margins(system: LinearSystem, opened: Sequence[str], growth: float = 0.0) -> Margins:
    """Margins of the sampled loops of any system, with the delays that its master gives them.

    Parameters
    ----------
    system : LinearSystem
    opened : sequence of str
        Connected inputs at which the loops are opened, ``plant.tau``: each while those of all others are closed.
    growth : float [1/s]
        As of :class:`Loop`.

    Raises
    ------
    UsageError
        For unknown inputs, and for a master that takes signals as continuous.
    """
    if system.algorithm in CONTINUOUS:
        raise UsageError(
            f"margins: expected gauss-seidel or jacobi, which sample the signals, got {system.algorithm}."
        )
    loops, cut = system.sampled(opened), system.places(opened)
    returned = loops.C[
        len(loops.C) - len(cut) :
    ]  # nothing comes back in the same step: there is no algebraic loop
    plant = Linear(loops.A, loops.B[:, cut])
    return Loop(0.0, plant, returned, system.step, growth, discrete=True).margins(delay=0)


def _margins(L: Any, w: Floats) -> Floats:
    """Modulus, gain, phase and delay margin of loops L (m, n) at frequencies w (m,): (4, n).

    Between frequencies the logarithm of a loop is taken as linear.
    """
    found = np.full((4, L.shape[1]), np.inf)
    found[0] = np.abs(1.0 + L).min(axis=0)
    for i, loop in enumerate(L.T):
        size = np.log(np.abs(loop))
        left = np.angle(-loop)  # the lag that is left until -1
        if loop[-1].real < 0.0:  # at half the sampling frequency a loop is real
            left[-1] = 0.0
        change = np.angle(loop[1:] / loop[:-1])
        turn = np.flatnonzero((left[1:] * left[:-1] <= 0.0) & (np.abs(left[:-1]) < np.pi / 2.0))
        share = np.clip(-left[turn] / change[turn], 0.0, 1.0)
        gains = -(size[turn] + share * (size[turn + 1] - size[turn]))
        found[1, i] = np.exp(gains[gains > 0.0].min(initial=np.inf))
        cross = np.flatnonzero(size[1:] * size[:-1] <= 0.0)
        share = size[cross] / (size[cross] - size[cross + 1])
        lag = np.mod(left[cross] + share * change[cross], 2.0 * np.pi)
        found[2, i] = lag.min(initial=np.inf)
        found[3, i] = (lag / (w[cross] + share * (w[cross + 1] - w[cross]))).min(initial=np.inf)
    return found
