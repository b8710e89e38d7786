"""Packages that mean harm: entries, XML and sources that are refused, with what, where and the fix."""

import stat
import struct
import warnings
import zipfile
from pathlib import Path

import pytest

from tests.engine.files import check_file
from tests.engine.texts import SPACES, binding, component, elements, ssd
from tests.hostile.packages import pack
from tests.system.package.problems import problems, write
from vdfmu.base.errors import SspError
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.read import load_ssp

SSV = f'<ssv:ParameterSet {SPACES} version="1.0" name="p"><ssv:Parameters>{{}}</ssv:Parameters></ssv:ParameterSet>'
SSM = f'<ssm:ParameterMapping {SPACES} version="1.0">{{}}</ssm:ParameterMapping>'


def test_entries_that_are_links_or_one_file_on_other_systems_are_refused_and_twice_have_one_content(tmp_path):
    path = write(tmp_path / "x.ssp", ssd())
    link = zipfile.ZipInfo("resources/link.fmu")
    link.create_system = 3
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "a") as file:
        file.writestr(link, "/etc/passwd")
    assert problems(path) == ["x.ssp: entry 'resources/link.fmu' is a symbolic link; pack the file itself"]
    (fault,) = problems(write(tmp_path / "x.ssp", ssd(), {"resources/A.fmu": b"", "resources/a.fmu": b""}))
    assert fault.startswith("x.ssp: entries 'resources/A.fmu' and 'resources/a.fmu' are one file")
    (fault,) = problems(write(tmp_path / "y.ssp", ssd(), {"resources": b"", "resources/a.fmu": b""}))
    assert fault == "y.ssp: entry 'resources' is a file and the folder of 'resources/a.fmu'"

    # All folders of this name would be texts of a gigabyte.
    path = write(tmp_path / "x.ssp", ssd(), {"a/" * 30_000 + "b": b""})
    with Archive(path, path.name) as archive:
        assert len(archive.names) == 2

    def doubled(path: Path, content: bytes) -> Path:
        write(path, ssd(), members={"a.txt": b"text"})
        with zipfile.ZipFile(path, "a") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            file.writestr("a.txt", content)
        return path

    assert problems(doubled(tmp_path / "x.ssp", b"same")) == [
        "x.ssp: entry 'a.txt' occurs twice, with different contents"
    ]
    path = doubled(tmp_path / "y.ssp", b"text")
    with Archive(path, path.name) as archive:
        assert (archive.names.count("a.txt"), len(archive.notes), archive.read("a.txt")) == (1, 1, b"text")
    data = bytearray(path.read_bytes())
    data[data.index(b"text")] ^= 1  # the first of two entries of one check sum is damaged
    path.write_bytes(data)
    assert problems(path) == ["y.ssp: entry 'a.txt' occurs twice, with different contents"]


def test_other_packing_methods_and_an_encrypted_entry_are_refused(tmp_path):
    path = write(tmp_path / "x.ssp", ssd())
    with zipfile.ZipFile(path, "a", zipfile.ZIP_LZMA) as file:
        file.writestr("a.fmu", bytes(1000))
    assert problems(path) == [
        "x.ssp: entry 'a.fmu' is packed by method 14; SSP and FMI allow 0 (stored) and 8 (deflated)"
    ]
    path = patched(write(tmp_path / "x.ssp", ssd(), members={"a.fmu": b"secret"}), 8, 1, "<H")
    assert problems(path) == ["x.ssp: entry 'a.fmu' is encrypted; pack it without a password"]


def patched(path: Path, offset: int, value: int, form: str) -> Path:
    data = bytearray(path.read_bytes())
    central, local = data.rindex(b"PK\x01\x02"), data.rindex(b"PK\x03\x04")
    for start in (central + offset, local + offset - 2):  # the local header has one field of two bytes less
        struct.pack_into(form, data, start, value)
    path.write_bytes(bytes(data))
    return path


def test_a_false_size_unpacks_no_more_than_it_says_and_a_flood_of_bad_entries_is_cut(tmp_path):
    """A bomb that declares 10 bytes: what is read is bounded by that, and its check sum gives it away."""
    path = patched(write(tmp_path / "x.ssp", ssd(), members={"a.fmu": bytes(10_000_000)}), 24, 10, "<I")
    with Archive(path, "x.ssp") as opened, pytest.raises(SspError, match="'a.fmu' cannot be unpacked: Bad CRC-32"):
        opened.read("a.fmu")
    path = write(tmp_path / "x.ssp", ssd(), members={f"../{i}": b"" for i in range(60)})
    faults = problems(path)
    assert len(faults) == 51
    assert faults[-1] == "x.ssp: and 10 more such entries"


BOMB = '<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa">{}]>'.format(
    "".join(f'<!ENTITY {chr(98 + i)} "{"".join([f"&{chr(97 + i)};"] * 10)}">' for i in range(9))
)
EVIL = {
    "billion laughs": (BOMB, 'name="{}&j;"'),
    "external entity": ('<!DOCTYPE d [<!ENTITY e SYSTEM "file:///etc/passwd">]>', "&e;"),
    "parameter entity": ('<!DOCTYPE d [<!ENTITY % e SYSTEM "http://localhost:1/x"> %e;]>', ""),
    "external subset": ('<!DOCTYPE d SYSTEM "http://localhost:1/x.dtd">', ""),
}


@pytest.mark.parametrize("which", EVIL)
@pytest.mark.parametrize("file", ["SystemStructure.ssd", "p.ssv", "m.ssm", "modelDescription.xml"])
def test_entities_are_refused_in_every_kind_of_file(tmp_path, which, file):
    doctype, text = EVIL[which]
    evil = f"{doctype}<x {text}/>" if "=" in text else f"{doctype}<x>{text}</x>"
    system = ssd(elements(component(inner=binding("p.ssv", "m.ssm"))))
    members = {"SystemStructure.ssd": system, "a.fmu": b"", "p.ssv": SSV.format(""), "m.ssm": SSM.format("")}
    read, name = (check_file, "x.fmu") if file == "modelDescription.xml" else (problems, "x.ssp")
    (tmp_path / name).write_bytes(pack({**members, file: evil}))
    (fault,) = read(tmp_path / name)
    assert f"{file}: has a document type declaration, not allowed because of entities; remove it" in fault


def test_an_xinclude_is_refused(tmp_path):
    include = (
        '<ssd:Annotations><ssc:Annotation type="t"><xi:include xmlns:xi="http://www.w3.org/2001/XInclude" '
        'href="file:///etc/passwd" parse="text"/></ssc:Annotation></ssd:Annotations>'
    )
    (fault,) = problems(write(tmp_path / "x.ssp", ssd(include)))
    assert "has an XInclude, not allowed" in fault


@pytest.mark.parametrize("source", [
    "..%2fout.fmu", "%2e%2e/out.fmu", "..%5cout.fmu", "resources/../../out.fmu", "/etc/out.fmu", "%2Fetc/out.fmu",
    "//host/out.fmu", "http://localhost:1/out.fmu", "file:///etc/out.fmu", "C:/out.fmu", "C:\\out.fmu",
    "a.fmu?x=1",
])  # fmt: skip
def test_sources_outside_the_package_are_refused(tmp_path, source):
    faults = problems(write(tmp_path / "x.ssp", ssd(elements(component("a", source, binding(source)))), {"a.fmu": b""}))
    assert len(faults) == 2
    assert all("is not a relative path inside the package; put the file into the package" in f for f in faults)
    assert faults[0].startswith("x.ssp: component 'a': source ")
    assert faults[1].startswith("x.ssp: parameter binding of a: source ")


def test_a_source_is_decoded_once(tmp_path):
    (fault,) = problems(write(tmp_path / "x.ssp", ssd(elements(component("a", "%252e%252e%252fout.fmu")))))
    assert fault == "x.ssp: component 'a': the package has no '%2e%2e%2fout.fmu'"
    body = ssd(elements(component("a", "my%20arm.fmu")))
    assert load_ssp(write(tmp_path / "y.ssp", body, {"my arm.fmu": b""})).components[0].source == "my arm.fmu"
