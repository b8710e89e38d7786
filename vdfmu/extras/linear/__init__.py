"""Modes and margins at the command line, and frequency responses with their resonances."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.linear.responses import Bode, bode, joint_bode

__all__ = ["Bode", "bode", "joint_bode"]
__getattr__ = lazy(__name__, {"responses": __all__})
