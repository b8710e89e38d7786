"""What a native FMU holds: libraries, sources, pages, reference results that the unit makes again."""

import os
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest
from lxml import etree

from tests.compiler.conftest import Lazy
from tests.compiler.exports import REFERENCE
from tests.engine.files import members
from vdfmu.arm.fmus import build_fmus
from vdfmu.base import platforms
from vdfmu.engine.inspect.fmu import related_notes

VERSIONS = ("2.0", "3.0")
pytestmark = pytest.mark.heavy  # FMUs for all platforms


@pytest.fixture(scope="module")
def native(planar, tmp_path_factory):
    out = tmp_path_factory.mktemp("native")
    return Lazy(lambda v: build_fmus(planar, out / v, backend="native", fmi_version=v, platforms="all", folded=True))


@pytest.fixture(params=VERSIONS)
def version(request):
    return request.param


@pytest.mark.parametrize(("chosen", "folders"), [
    (["aarch64-linux"], {"aarch64-linux", "linux64"}),
    (["x86_64-linux", "aarch64-linux"], {"aarch64-linux", "linux64"}),
    (["aarch64-darwin"], {"aarch64-darwin", "darwin64"}),
    (["x86_64-darwin"], {"darwin64"}),
    (["x86_64-windows"], {"win64"}),
])  # fmt: skip
def test_importers_of_fmi_2_find_a_library_in_the_folder_of_their_system(chosen, folders):
    files = platforms.binaries("Plant", {name: name.encode() for name in chosen}, "2.0")
    assert {path.split("/")[1] for path in files} == folders
    if "x86_64-linux" in chosen:
        assert files["binaries/linux64/Plant.so"] == b"x86_64-linux"


def test_the_manifest_is_that_of_the_layered_standard(native, version, unit_name):
    """Root attributes by the schema that FMI 3.0 has for all layered standards; files that exist."""
    inside = members(native[version][unit_name])
    manifest = inside[f"{REFERENCE}fmi-ls-manifest.xml"]
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3LayeredStandardManifest.xsd"
    root = etree.fromstring(manifest)
    common = etree.Element("fmiLayeredStandardManifest", dict(root.attrib), nsmap=root.nsmap)
    space = etree.parse(schema).getroot().get("targetNamespace")
    common.tag = f"{{{space}}}fmiLayeredStandardManifest"
    etree.XMLSchema(etree.parse(schema)).assertValid(common)
    assert related_notes(root) == []
    for related in ElementTree.fromstring(manifest):
        source = os.path.normpath(REFERENCE + related.get("source", ""))
        assert source.replace(os.sep, "/") in inside
    results = [r.get("source") for r in root if r.get("role") == "result"]
    assert results == [f"{native[version][unit_name].stem}_out.csv"]


def test_reference_results_end_where_an_arm_runs_away(planar, tmp_path):
    """Torques that no spring could hold: the results stop, the build goes on."""
    start = {"plant": {"equilibrium": False, "tau_s_0[1]": 1e300, "kappa_dot_0[1]": 1e300}}
    path = build_fmus(planar, tmp_path, units=["plant"], parameters=start, backend="native", folded=True)["plant"]
    rows = members(path)[f"{REFERENCE}Plant_out.csv"].decode().splitlines()
    assert len(rows) < 22
    assert not {"nan", "inf"} & set(",".join(rows[1:]).split(","))
