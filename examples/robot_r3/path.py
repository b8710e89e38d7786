"""A motion from point to point, as fast as speeds and accelerations allow."""

from vdfmu.unit import JOINTS, Output, Parameter, Unit, clip, minimum


class PointToPoint(Unit):
    """Straight way of the joints with an acceleration, a constant speed and a deceleration, in one common time.

    ::

        s_ddot = a, 0, -a      q_d = q_start + (q_end - q_start) s      s from 0 to 1

    The speed v and the acceleration a of s are the largest that no joint forbids, as in KinematicPTP2 of the Modelica
    Standard Library. The speed must be reached before the middle of the way.
    """

    q_d = Output("position", JOINTS, "desired position")
    q_d_dot = Output("velocity", JOINTS, "desired velocity")
    q_start = Parameter("position", JOINTS, "position before the motion")
    q_end = Parameter("position", JOINTS, "position after the motion", start=0.5)
    speed = Parameter("velocity", JOINTS, "largest speed", start=1.0, minimum=1e-6)
    acceleration = Parameter("acceleration", JOINTS, "largest acceleration", start=1.0, minimum=1e-6)

    def outputs(self) -> None:
        way = self.q_end - self.q_start
        v, a = 1e9, 1e9
        for i in range(self.n):
            v = minimum(v, self.speed[i] / (abs(way[i]) + 1e-12))
            a = minimum(a, self.acceleration[i] / (abs(way[i]) + 1e-12))
        rise, fall = v / a, 1.0 / v  # times [s] at which the speed is reached, and at which it is left
        up = clip(self.t, 0.0, rise)
        even = clip(self.t - rise, 0.0, fall - rise)
        down = clip(self.t - fall, 0.0, rise)
        s = a * up**2 / 2 + v * even + v * down - a * down**2 / 2
        self.q_d = self.q_start + way * s
        self.q_d_dot = way * a * (up - down)
