"""From equations to fast functions: traced once, kept, their derivatives, prepared buffers, a step of the solver."""

from vdfmu.compiler.functions.functions import Functions, KernelFunction, traced_function

__all__ = ["Functions", "KernelFunction", "traced_function"]
