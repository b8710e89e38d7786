"""FMUs and systems of the tests of the engine, and a rule for each finding of a report."""

from tests.engine.check.conftest import numbered as numbered
from tests.engine.conftest import arm_package as arm_package
from tests.engine.conftest import built as built
from tests.engine.conftest import fmus as fmus
from tests.engine.conftest import pack as pack
from tests.engine.conftest import system as system
