"""The entries for lists of tools, in ``docs/listing``: each in the form of its list, and true."""

import json
import re
import tomllib
from pathlib import Path

import yaml
from lxml import html

import vdfmu
from vdfmu.arm.units import shipped_units
from vdfmu.base.platforms import PLATFORMS
from vdfmu.base.standards import FMI_VERSIONS, SSP_FORMATS
from vdfmu.compiler.fmu.description import model_description, model_description_3
from vdfmu.compiler.fmu.reference_results import FOLDER
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.fmu.description import KINDS
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator

ROOT = Path(__file__).resolve().parents[2]
LISTING = ROOT / "docs" / "listing"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EMPTY = {
    "fmi-standard.org.json": '"url": ""|"vendorURL": ""|"examplesURL": ""', "ssp-standard.org.html": 'href=""',
    "efmi-standard.org.md": r"\]\(\)", "awesome-fmi.md": r"\]\(\)", "awesome-robotics-libraries.yaml": 'github: ""',
}  # fmt: skip
"""Addresses that the project does not have yet, in each entry."""


def text(name):
    return (LISTING / name).read_text(encoding="utf-8")


def test_each_entry_is_in_the_lists_of_fmi_ssp_efmi_and_awesome_things():
    listed = text("README.md")
    assert {path.name for path in LISTING.iterdir()} == {"README.md", *EMPTY}
    for name, empty in EMPTY.items():
        assert f"| `{name}` |" in listed and re.search(empty, text(name)), name
    assert "urls" not in PROJECT  # once there is an address, it goes into the entries
    entry = json.loads(text("fmi-standard.org.json"))
    assert (entry["license"], PROJECT["license"], entry["vendor"]) == ("osi", "MIT", PROJECT["authors"][0]["name"])
    assert entry["fmiVersions"] == [*FMI_VERSIONS]
    systems = {"darwin": "macOS", "linux": "Linux", "windows": "Windows"}
    built = {systems[name.split("-")[1]] for name in PLATFORMS if "-" in name}
    assert {*entry["platforms"]} == built | {"Source Code"}
    plant = Interface(shipped_units()["plant"], vdfmu.load_robot("planar_2dof"))
    for made in (model_description(plant, "{}", "", {}, ("unit.c",)), model_description_3(plant, "{}", "", {})):
        kinds = [kind for kind in KINDS if made.find(kind) is not None]
        assert ["".join(re.findall("[A-Z]", kind)) for kind in kinds] == entry["fmuExport"]
    # what runs: tests/engine/test_model_exchange.py, with the refusal of what is for scheduled execution alone
    assert entry["fmuImport"] == ["CS", "ME"] and ModelExchangeIntegrator
    assert FOLDER.endswith("fmi-ls-ref") and entry["layeredStandards"] == ["REF"]
    row = html.fromstring(f"<table>{text('ssp-standard.org.html')}</table>")
    cells = [" ".join(cell.text_content().split()) for cell in row.iter("td")]
    versions = "/".join(SSP_FORMATS)
    assert (cells[0], cells[1], *cells[3:]) == ("vdfmu", PROJECT["authors"][0]["name"], "free", versions, versions)
    first, *_ = text("efmi-standard.org.md").splitlines()
    assert f"**Since version:** {vdfmu.__version__.rpartition('.')[0]} " in first
    assert re.fullmatch(r"- \[vdfmu\]\(\) - Python package .*\. \[MIT\]\n", text("awesome-fmi.md"))
    (entry,) = yaml.safe_load(text("awesome-robotics-libraries.yaml"))
    assert (entry["name"], entry["license"]) == ("vdfmu", PROJECT["license"])
