"""An encoder for the position of each joint."""

import numpy as np

from vdfmu.unit import JOINTS, Input, Output, Parameter, Sampled, Unit


class Encoder(Unit):
    """Position as an encoder gives it: in steps of its resolution, one sample late."""

    q = Input("position", JOINTS, "position")
    q_measured = Output("position", JOINTS, "measured position")
    resolution = Parameter("rad", text="resolution", start=2e-5, minimum=1e-12)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    newest = Sampled("position", JOINTS, "newest sample")
    before = Sampled("position", JOINTS, "sample before it")

    def update(self) -> None:
        self.before = self.newest
        self.newest = self.resolution * np.floor(self.q / self.resolution + 0.5)

    def outputs(self) -> None:
        self.q_measured = self.before
