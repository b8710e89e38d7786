"""The phases of an instance of the plant."""

from tests.compiler.native.binding import Instance

PHASES = {
    "CoSimulation": ("instantiated", "initialization", "step", "terminated"),
    "ModelExchange": ("instantiated", "initialization", "event", "continuous", "terminated"),
}
CASES = [(kind, phase) for kind, phases in PHASES.items() for phase in phases]


def bring(instance: Instance, phase: str) -> Instance:
    """Take a new instance to a phase."""
    instance.set(q_0=[0.3, -0.2]).setup(1.0)
    if phase == "instantiated":
        return instance
    instance.enter()
    if phase == "initialization":
        return instance
    instance.do("ExitInitializationMode")
    if phase == "step":
        instance.step(tau=0.1)
    elif phase == "continuous":
        instance.continuous()
    elif phase == "terminated":
        instance.do("Terminate")
    return instance
