"""Everything to write a unit of one's own: its base class, its variables, and functions that can be traced."""

from typing import Any

from vdfmu.compiler.unit import *  # noqa: F403
from vdfmu.compiler.unit import __all__ as __all__


def __getattr__(name: str) -> Any:
    """Return what a deprecated name is now."""
    from vdfmu.base.words import renamed

    return renamed(__name__, globals(), name)
