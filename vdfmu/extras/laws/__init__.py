"""Control laws other than PD and virtual decomposition, observers, sensors and actuators, and optimal gains."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.laws.gains import StateGains, state_gains

__all__ = ["StateGains", "state_gains"]
__getattr__ = lazy(__name__, {"gains": __all__})
