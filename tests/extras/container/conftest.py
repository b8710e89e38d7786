"""Packages of small FMUs."""

from tests.engine.conftest import built as built
from tests.engine.conftest import fmus as fmus
from tests.engine.conftest import pack as pack
from tests.engine.conftest import system as system
