"""Results that are hard to write."""

from tests.engine.conftest import results as results
