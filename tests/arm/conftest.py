"""Arms for the laws that every arm meets."""

import pytest

from tests.arm.balanced import BALANCED
from tests.conftest import TYPICAL, make_general_chain
from vdfmu.arm.robot import load_robot


@pytest.fixture(scope="session", params=(*TYPICAL, "general"))
def chain(request):
    """Return each typical robot and the random general chain, or an arm with counterbalances."""
    if request.param in BALANCED:
        return BALANCED[request.param]
    return make_general_chain() if request.param == "general" else load_robot(request.param)
