"""A system without a robot: a DC motor and a controller of its speed."""

from pathlib import Path

UNITS = '''
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit


class DCMotor(Unit):
    """DC motor with a load."""

    u = Input("V")
    R = Parameter("Ohm", start=1.0)
    L = Parameter("H", start=0.01)
    k = Parameter("N.m/A", start=0.05)
    J = Parameter("kg.m2", start=1e-4)
    b = Parameter("N.m.s/rad", start=1e-4)
    i = State("A")
    w = State("rad/s")
    i_dot = Derivative(i)
    w_dot = Derivative(w)

    def derivatives(self) -> None:
        self.i_dot = (self.u - self.R * self.i - self.k * self.w) / self.L
        self.w_dot = (self.k * self.i - self.b * self.w) / self.J


class SpeedPI(Unit):
    """PI controller of a speed."""

    w = Input("rad/s")
    w_d = Input("rad/s")
    K_p = Parameter("V.s/rad", start=0.05, tunable=True)
    K_i = Parameter("V/rad", start=1.0)
    e = State("rad")
    e_dot = Derivative(e)
    u = Output("V")

    def derivatives(self) -> None:
        self.e_dot = self.w_d - self.w

    def outputs(self) -> None:
        self.u = self.K_p * (self.w_d - self.w) + self.K_i * self.e
'''
SYSTEM = """
name = "drive"
[components]
controller = "motor.py:SpeedPI"
motor = "motor.py:DCMotor"
[connections]
"controller.u" = "motor.u"
"motor.w" = "controller.w"
"""
SCENARIO = """
name = "motor"
description = "A step of the speed"
system = "drive.toml"
stop = 0.5
step = 0.001
[controller]
w_d = 100.0
"""


def write_motor(folder: Path) -> None:
    """Write the units, their system and its scenario ``motor.toml``."""
    for name, text in {"motor.py": UNITS, "drive.toml": SYSTEM, "motor.toml": SCENARIO}.items():
        (folder / name).write_text(text)
