"""Arms that are decomposed at their cutting points: a component for each joint and each link."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.decompose.decomposition import decomposed

__all__ = ["decomposed"]
__getattr__ = lazy(__name__, {"decomposition": ("decomposed",)})
