"""Motions along paths of the end effector: lines and circles."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.paths.cartesian import circle, line

__all__ = ["circle", "line"]
__getattr__ = lazy(__name__, {"cartesian": __all__})
