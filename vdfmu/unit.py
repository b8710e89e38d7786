"""Everything to write a unit of one's own: its base class, its variables, and functions that can be traced."""

from vdfmu.compiler.unit import *  # noqa: F403
from vdfmu.compiler.unit import __all__ as __all__
