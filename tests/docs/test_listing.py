"""The entry for the list of FMI tools, ``docs/listing/fmi-standard.org.json``: what it says of standards is true."""

import json
from pathlib import Path

from vdfmu.base.platforms import PLATFORMS
from vdfmu.base.standards import FMI_VERSIONS

LISTING = Path(__file__).resolve().parents[2] / "docs" / "listing"


def test_the_entry_of_fmi_has_the_standards_and_platforms_that_there_are():
    entry = json.loads((LISTING / "fmi-standard.org.json").read_text(encoding="utf-8"))
    assert entry["fmiVersions"] == [*FMI_VERSIONS] and entry["fmuImport"] == ["CS", "ME"]
    systems = {"darwin": "macOS", "linux": "Linux", "windows": "Windows"}
    built = {systems[name.split("-")[1]] for name in PLATFORMS if "-" in name}
    assert {*entry["platforms"]} == built | {"Source Code"}
