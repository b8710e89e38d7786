"""What a unit of one's own is written with: its base class, its variables, and functions that can be traced."""

from vdfmu.compiler.unit import *  # noqa: F403
from vdfmu.compiler.unit import __all__ as __all__
