"""From equations to fast functions: symbolic trace, cache, prepared buffers."""

from vdfmu.kernel.functions import Kernel, KernelFunction
from vdfmu.kernel.structure import Parameter, parameters

__all__ = ["Kernel", "KernelFunction", "Parameter", "parameters"]
