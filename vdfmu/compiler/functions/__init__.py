"""From equations to fast functions: symbolic trace, cache, prepared buffers."""

from vdfmu.arm.robot.structure import Parameter, parameters
from vdfmu.compiler.functions.functions import Kernel, KernelFunction

__all__ = ["Kernel", "KernelFunction", "Parameter", "parameters"]
