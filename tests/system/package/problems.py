"""What the reading of a package refuses."""

from pathlib import Path

import pytest

from vdfmu.base.errors import SspError
from vdfmu.engine.package.read import load_ssp


def problems(path: Path) -> list[str]:
    """Return the problems for which a package is refused."""
    with pytest.raises(SspError) as info:
        load_ssp(path)
    return info.value.problems
