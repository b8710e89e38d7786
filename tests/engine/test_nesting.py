"""Files with thousands of faults: read in proportion to their size."""

import io
import zipfile

import pytest

from tests.engine.texts import SPACES
from vdfmu.engine.package.read import read_system


def ssd(inside, units=""):
    system = f'<ssd:System name="b">{inside}</ssd:System>{units}'
    return f'<ssd:SystemStructureDescription {SPACES} version="1.0" name="b">{system}</ssd:SystemStructureDescription>'


def elements(items):
    return f"<ssd:Elements>{''.join(items)}</ssd:Elements>"


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a package of files; it returns the system and the problems."""

    def reader(**files):
        box = io.BytesIO()
        with zipfile.ZipFile(box, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in files.items():
                archive.writestr({"main": "SystemStructure.ssd"}.get(name, f"{name}.ssd"), text)
        (tmp_path / "n.ssp").write_bytes(box.getvalue())
        return read_system(tmp_path / "n.ssp")

    return reader


@pytest.mark.parametrize("n", [100, 2000])
def test_thousands_of_breaches_of_a_schema_are_counted_and_the_first_reported(read, n):
    """With lines up to 1,000. Deep in a file libxml2 would take half a minute for lines of all of these."""
    inside = elements(
        ['<ssd:System nam=""/>\n' for _ in range(n // 2)]
    )  # an unknown attribute, and no name: 2 breaches
    for _ in range(100):
        inside = elements([f'<ssd:System name="s">{inside}</ssd:System>'])
    _, problems = read(main=ssd(inside))
    assert "attribute 'nam'" in problems[0]
    if n <= 1000:
        assert len(problems) == n and problems[-1].line == n // 2
    else:
        assert len(problems) == 1 and f"the first of {n} violations of the schema" in problems[0]
