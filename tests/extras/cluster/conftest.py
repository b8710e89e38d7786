"""The unit that misbehaves, of the tests of sweeps."""

from tests.study.sweeps.conftest import undisturbed as undisturbed
from tests.study.sweeps.conftest import wild as wild
