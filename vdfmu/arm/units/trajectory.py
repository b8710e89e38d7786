"""The unit Trajectory: the desired motion."""

from __future__ import annotations

from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.signals import DESIRED
from vdfmu.compiler.unit import JOINTS, Output, Parameter, Terminal, Unit


class Trajectory(Unit):
    """Desired joint trajectory with four time derivatives, Eq. (57).

    With s = (t - t_start) / T, limited to 0 .. 1::

        q_d = q_start + (q_end - q_start) (s - sin(2 pi s) / (2 pi))

    The other outputs are its first four derivatives in time. The motion starts and ends at rest and is held before and
    after. The third derivative jumps at both ends. There it has the value just after the jump: 0 at the end.
    """

    sampled = False
    q_d = Output(*DESIRED["q_d"])
    q_d_dot = Output(*DESIRED["q_d_dot"])
    q_d_ddot = Output(*DESIRED["q_d_ddot"])
    q_d_dddot = Output(*DESIRED["q_d_dddot"])
    q_d_ddddot = Output(*DESIRED["q_d_ddddot"])
    q_start = Parameter("position", JOINTS, "position before the motion")
    q_end = Parameter("position", JOINTS, "position after the motion", start=0.5)
    T = Parameter("s", text="Duration of the motion", start=10.0, minimum=1e-6)
    t_start = Parameter("s", text="Start of the motion")
    terminals = (Terminal("desired", "right", tuple(DESIRED), "Desired motion of the joints"),)
    experiment_stop = 10.0

    def outputs(self) -> None:
        """Eq. (57) and its derivatives."""
        motion = desired_motion(self.t, self.q_start, self.q_end, self.T, self.t_start)
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = motion
