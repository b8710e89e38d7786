"""A component that takes a given processor time a step, as the script of a Python FMU."""

import time

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Burner(Fmi2Slave):
    """Adds 1 to its input, after `burn` seconds of work."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__(**kwargs)
        self.u = self.y = self.burn = 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        kind = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("burn", **kind))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Work."""
        end = time.thread_time() + self.burn
        while time.thread_time() < end:
            pass
        self.y = self.u + 1.0
        return True
