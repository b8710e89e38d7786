"""A whole system as one FMU."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.container.containers import write_container

__all__ = ["write_container"]
__getattr__ = lazy(__name__, {"containers": __all__})
