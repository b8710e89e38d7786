"""Packages of small FMUs."""

from tests.engine.conftest import fmus as fmus
from tests.engine.conftest import pack as pack
