"""The unit Wall: a plane that the end effector touches."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.signals import WRENCH, six, tool_inputs
from vdfmu.arm.world.contact import friction_force, normal_force
from vdfmu.compiler.unit import Output, Parameter, Terminal, Unit


class Wall(Unit):
    """Plane wall with friction, for the end effector of a plant with coupled_tool.

    ::

        depth = n' p_O - distance                         of the origin of {O} behind the plane
        N     = k depth max(0, 1 + c depth_dot)           Hunt and Crossley, for a depth above 0; else 0
        T     = mu N v_t / sqrt(|v_t|^2 + v_eps^2)          along the sliding velocity v_t
        F_e   = [R_O' (N n + T), 0]                       wrench of the arm on the wall, in {O}

    n is the direction of `normal`, into the wall. A wrench that is held over a step h is stable for
    ``k h / 2 < d < 2 m / h``, d the damping and m the apparent mass of the arm in the direction: along the normal
    ``d = c N`` and more by the arm's own; in the plane k is 0 and ``d = mu N / v_eps``.
    """

    sampled = False
    p_O, R_O, V_O = tool_inputs()
    F_e = Output(*WRENCH, six("Force of the arm on the wall in {O}", "Moment of the arm on the wall in {O}"))
    depth = Output("m", text="Depth of the end effector behind the plane")
    N = Output("N", text="Normal force")
    normal = Parameter("1", 3, "Direction into the wall in {I}, of any norm, axis", start=[1.0, 0.0, 0.0])
    distance = Parameter("m", text="Distance of the plane from the origin of {I}, along the normal", start=10.0)
    k = Parameter("N/m", text="Stiffness", start=2e4, minimum=0.0, tunable=True)
    c = Parameter("s/m", text="Damping divided by stiffness and depth", start=2.0, minimum=0.0, tunable=True)
    mu = Parameter("1", text="Coefficient of friction", start=0.3, minimum=0.0, tunable=True)
    v_eps = Parameter("m/s", text="Speed that regularises the direction of friction", start=0.1, minimum=1e-9)
    terminals = (Terminal("end_effector", "left", ("p_O", "R_O", "V_O", "F_e"), "Motion and wrench of the tool"),)

    def requirements(self) -> dict[str, tuple[str, float]]:
        """Require a normal."""
        return {"normal": ("a direction", self.normal @ self.normal)}

    def outputs(self) -> None:
        """Force of the plane, and its friction."""
        n = self.normal / np.sqrt(self.normal @ self.normal)
        v = self.R_O @ self.V_O[:3]
        rate = n @ v
        self.depth = n @ self.p_O - self.distance
        self.N = normal_force(self.k, self.c, self.depth, rate)
        force = self.N * n + friction_force(self.mu, self.v_eps, self.N, v - rate * n)
        self.F_e = np.concatenate([self.R_O.T @ force, np.zeros(3)])

    def experiment(self) -> None:
        """Push and slide."""
        self.p_O = np.array([self.distance + 1e-3 * np.sin(2.0 * self.t), 0.0, 0.0])
        self.V_O = 0.1 * np.cos(2.0 * self.t + np.arange(6.0))
