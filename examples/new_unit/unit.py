"""A new unit. To build its FMU: vdfmu build FILE.py"""

from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit


class NAME(Unit):
    """Proportional-integral controller.

    The first line is the description of the FMU, and the whole text is on the FMU's page::

        e     = r - y
        z_dot = e
        u     = K (e + z / T)
    """

    # Variables: unit of measurement ("1" is a number without one), shape (none is a scalar, JOINTS one for each joint),
    # and a text. They are attributes of the class here, and their values in the methods.
    r = Input("1", text="setpoint")
    y = Input("1", text="measured value")
    u = Output("1", text="actuating signal")
    # Without tunable=True a parameter is fixed over a run.
    K = Parameter("1", text="gain", start=2.0, minimum=0.0, tunable=True)
    T = Parameter("s", text="integral time", start=0.5, minimum=1e-6, tunable=True)
    # The FMU integrates a continuous state. It starts at the parameter z_0, which is added automatically.
    z = State("s", text="integral of the error")
    z_dot = Derivative(z)

    def outputs(self) -> None:
        """Set the outputs, in numpy. Branches on values are where(condition, a, b), clip, minimum, maximum."""
        e = self.r - self.y
        self.u = self.K * (e + self.z / self.T)

    def derivatives(self) -> None:
        """Set the derivatives of the states."""
        self.z_dot = self.r - self.y
