"""Scenarios of sampled units, and how near runs side by side are to those of the FMUs."""

POSITION = 1e-9
"""[rad] What is asked for. Rounding alone gives 1e-15 in the runs here; where it decides whether an internal step is
taken, the local errors of two ways to go on remain, 4.5e-10 rad over 10 s of the paper's arm (docs/internals.md)."""

REST = 1e-7
"""Of the largest value of any other signal, which follow the positions by gains of a hundred 1/s and more."""


def scenario_file(folder, units):
    (folder / "system.toml").write_text(f'name = "own"\ndescription = "units of a user"\n\n[components]\n{units}')
    (folder / "scenario.toml").write_text(
        'name = "own"\ndescription = "units of a user"\nsystem = "system.toml"\n'
        'robot = "planar_2dof"\nstop = 0.2\nstep = 0.01\nalgorithm = "gauss-seidel"\ntolerance = 1e-8\n'
    )
    return folder / "scenario.toml"


CHOPPER = """
import numpy as np

from vdfmu.unit import Derivative, Input, Parameter, State, Unit, where


class Chopper(Unit):
    \"\"\"A low pass of a voltage that is switched by time.\"\"\"

    u = Input("V")
    f = Parameter("1/s", text="frequency", start=40.0)
    y = State("V", text="filtered voltage")
    y_dot = Derivative(y)

    def derivatives(self) -> None:
        \"\"\"On in the first third of each period.\"\"\"
        on = self.t * self.f - np.floor(self.t * self.f) < 0.3
        self.y_dot = 100.0 * (where(on, 1.0 + self.u, 0.0) - self.y)
"""

NOISY = """
import numpy as np

from vdfmu.unit import Derivative, Input, Parameter, Sampled, State, Unit, normal, seeded


class Noisy(Unit):
    \"\"\"A sampled, rounded and noisy value, and the sum of its input.\"\"\"

    y = Input("V")
    seed = Parameter("1", text="seed", start=3.0)
    period = Parameter("s", text="time between samples", start=7e-3, minimum=1e-6)
    s = State("V.s", text="sum")
    s_dot = Derivative(s)
    random = Sampled("1", 6, "state of the random numbers")
    z = Sampled("V", text="measured value")

    def start(self) -> None:
        \"\"\"Seed.\"\"\"
        self.random, self.z, self.s = seeded(self.seed), 0.0, 0.0

    def update(self) -> None:
        \"\"\"Draw and round.\"\"\"
        (noise,), self.random = normal(self.random, 1)
        self.z = 0.01 * np.floor((self.y + 0.02 * noise) / 0.01 + 0.5)

    def derivatives(self) -> None:
        \"\"\"Integrate.\"\"\"
        self.s_dot = self.y + self.z
"""


def switched_file(folder):
    """Write a scenario of a chopper and a noisy, sampled unit, each of which reads the other."""
    (folder / "chopper.py").write_text(CHOPPER)
    (folder / "noisy.py").write_text(NOISY)
    units = 'a = "chopper.py"\nb = "noisy.py"\n\n[connections]\n"a.y" = ["b.y"]\n"b.z" = ["a.u"]\n'
    return scenario_file(folder, units)
