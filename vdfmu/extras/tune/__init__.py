"""Tuning: finds parameters of a scenario that minimise a cost over a spread of robots and within limits."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.tune.search import Tuned, tune

__all__ = ["Tuned", "tune"]
__getattr__ = lazy(__name__, {"search": __all__})
