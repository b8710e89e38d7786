"""One short run of the small arm, shared by the tests of studies."""

import zipfile

import pytest

import vdfmu
from vdfmu.engine.inspect.inspection import Report
from vdfmu.engine.rules import Finding


def members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="session")
def planar_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planar")
    return folder, vdfmu.run("planar_tracking", stop=0.2, out=folder)


@pytest.fixture(autouse=True)
def numbered(monkeypatch):
    """Hold of every report that a test makes that each of its findings has a rule."""
    plain = Report.of

    def report(*arguments):
        made = plain(*arguments)
        assert all(isinstance(text, Finding) for text in (*made.problems, *made.notes)), made
        return made

    monkeypatch.setattr(Report, "of", report)
