"""Indices of sensitivity of studies: which axes a measure depends on."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.sensitivity.sensitivities import Indices, indices

__all__ = ["Indices", "indices"]
__getattr__ = lazy(__name__, {"sensitivities": __all__})
