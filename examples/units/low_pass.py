"""A low-pass filter."""

from vdfmu.unit import Derivative, Input, Parameter, State, Unit


class LowPass(Unit):
    """First-order low-pass filter.

    ::

        T y_dot = u - y
    """

    u = Input("1", text="signal")
    T = Parameter("s", text="time constant", start=0.1, minimum=1e-6)
    y = State("1", text="filtered signal")
    y_dot = Derivative(y)

    def derivatives(self) -> None:
        self.y_dot = (self.u - self.y) / self.T
