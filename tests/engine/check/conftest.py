"""Reports on files: each of their findings has a rule."""

import pytest

from vdfmu.engine.inspect.inspection import Report
from vdfmu.engine.rules import Finding


@pytest.fixture(autouse=True)
def numbered(monkeypatch):
    """Hold of every report that a test makes that each of its findings has a rule."""
    plain = Report.of

    def report(*arguments):
        made = plain(*arguments)
        assert all(isinstance(text, Finding) for text in (*made.problems, *made.notes)), made
        return made

    monkeypatch.setattr(Report, "of", report)
