"""The arms of the tests of units."""

from tests.arm.conftest import chain as chain
