"""From equations to fast functions: symbolic trace, cache, prepared buffers, and the plant's solver."""

from vdfmu.kernel.functions import Kernel, KernelFunction
from vdfmu.kernel.integrator import Integrator
from vdfmu.kernel.structure import Parameter, parameters

__all__ = ["Integrator", "Kernel", "KernelFunction", "Parameter", "parameters"]
