"""The text of a unit."""

UNIT = '''
from vdfmu.unit import Input, Output, Unit

class Gain(Unit):
    """Gain."""
    # here
    u = Input("1")
    y = Output("1")

    def outputs(self) -> None:
        self.y = 2.0 * self.u
'''
