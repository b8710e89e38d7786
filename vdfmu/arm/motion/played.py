"""Units that output a motion, for :meth:`vdfmu.arm.motion.Motion.unit`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from vdfmu.arm.equations.trajectory import played_motion
from vdfmu.arm.signals import DESIRED
from vdfmu.compiler.unit import Output, Parameter, Terminal, Unit


class Played(Unit):
    """A motion of the joints with four continuous time derivatives.

    It is a polynomial of degree 5 between two knots, starts at ``t_start``, runs `speed` times as fast as planned, and
    is held before and after.
    """

    edges: ClassVar[Any] = np.array([0.0, 1.0, 2.0])
    rows: ClassVar[Any] = None
    """See :func:`~vdfmu.arm.equations.trajectory.played_motion`."""
    notes: ClassVar[tuple[str, ...]] = ()
    """Notes on the motion."""

    sampled = False
    q_d = Output(*DESIRED["q_d"])
    q_d_dot = Output(*DESIRED["q_d_dot"])
    q_d_ddot = Output(*DESIRED["q_d_ddot"])
    q_d_dddot = Output(*DESIRED["q_d_dddot"])
    q_d_ddddot = Output(*DESIRED["q_d_ddddot"])
    t_start = Parameter("s", text="Start of the motion")
    speed = Parameter("1", text="Speed relative to that for which the motion was worked out", start=1.0, minimum=1e-6)
    terminals = (Terminal("desired", "right", tuple(DESIRED), "Desired motion of the joints"),)

    @classmethod
    def begin(cls) -> list[float]:
        """Positions at the start of the motion."""
        return cls.rows[0, 1 : 1 + (cls.rows.shape[1] - 1) // 6].tolist()

    def repeats(self) -> Any:
        """Return the number of times that the motion is played."""
        return 1.0

    def outputs(self) -> None:
        """Play the motion."""
        motion = played_motion(self.speed * (self.t - self.t_start), self.edges, self.rows, self.repeats())
        scaled = [self.speed**order * value for order, value in enumerate(motion)]
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = scaled


class Cycle(Played):
    """A closed motion of the joints with four continuous time derivatives.

    It is a polynomial of degree 5 between two knots, repeated `cycles` times from ``t_start``, `speed` times as fast as
    planned, and held before and after.
    """

    cycles = Parameter("1", text="Number of times that the motion is played", start=1.0, minimum=1.0)

    def repeats(self) -> Any:
        """Return the number of times that the motion is played."""
        return np.floor(self.cycles)
