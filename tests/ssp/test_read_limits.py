"""Systems that refer to systems: how many elements and how deep, in every way of reference."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from vdfmu.errors import SspError
from vdfmu.ssp import archive, load_ssp
from vdfmu.study.check import check_file

SPACE = "http://ssp-standard.org/SSP1/SystemStructureDescription"
WAYS = ["definition", "package", "id"]


def ssd(elements: str, rest: str = "", attributes: str = "") -> str:
    inner = f"<ssd:Elements>{elements}</ssd:Elements>" if elements else ""
    return (
        f'<ssd:SystemStructureDescription xmlns:ssd="{SPACE}" version="1.0" name="t">'
        f'<ssd:System name="s" {attributes}>{inner}</ssd:System>{rest}</ssd:SystemStructureDescription>'
    )


def refer(count: int, source: str, way: str) -> str:
    kind = "" if way == "id" else f' type="application/x-ssp-{way}"'
    return "".join(f'<ssd:Component name="c{k}"{kind} source="{source}"/>' for k in range(count))


def pack(members: dict[str, str | bytes]) -> bytes:
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return box.getvalue()


def chain(path: Path, way: str, levels: int, fan: int) -> Path:
    """Write a system that refers `fan` times to one that refers `fan` times to the next, and so on."""
    if way == "definition":
        names = ["SystemStructure.ssd", *(f"in/s{k}.ssd" for k in range(1, levels + 1))]
        members: dict[str, str | bytes] = {
            name: ssd(refer(fan, after if name == names[0] else after[3:], way))
            for name, after in zip(names, names[1:], strict=False)
        }
        path.write_bytes(pack({**members, names[-1]: ssd("")}))
    elif way == "package":
        data = pack({"SystemStructure.ssd": ssd("")})
        for _ in range(levels):
            data = pack({"SystemStructure.ssd": ssd(refer(fan, "in.ssp", way)), "in.ssp": data})
        path.write_bytes(data)
    else:
        systems = [
            f'<ssd:System name="s{k}" id="s{k}"><ssd:Elements>{refer(fan, f"#s{k + 1}", way)}</ssd:Elements>'
            "</ssd:System>"
            for k in range(1, levels)
        ]
        systems.append(f'<ssd:System name="s{levels}" id="s{levels}"/>')
        path.write_bytes(pack({"SystemStructure.ssd": ssd(refer(fan, "#s1", way) + "".join(systems))}))
    return path


def problems(path: Path) -> list[str]:
    with pytest.raises(SspError) as info:
        load_ssp(path)
    return info.value.problems


@pytest.mark.parametrize("way", WAYS)
def test_references_that_multiply_are_stopped(tmp_path, monkeypatch, way):
    """8 levels with 10 references each are 10**8 elements; the file has some hundred."""
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 1000)  # for speed
    path = chain(tmp_path / "x.ssp", way, levels=8, fan=10)
    (found,) = problems(path)
    assert "the system has more than 1000 elements" in found
    assert "that is the limit (ELEMENT_LIMIT). Look for systems" in found
    assert check_file(path) == [found]


@pytest.mark.parametrize("way", ["definition", "package"])
def test_the_limit_counts_every_element_once(tmp_path, monkeypatch, way):
    path = chain(tmp_path / "x.ssp", way, levels=2, fan=3)  # 3 elements with 3 each
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 12)
    assert load_ssp(path).components == ()
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 11)
    assert "more than 11 elements" in problems(path)[0]


@pytest.mark.parametrize("way", ["definition", "id"])
def test_a_chain_of_references_has_a_limit(tmp_path, way):
    """Of an SSD with systems of its own, those count as well; packages have a lower limit of their own."""
    assert load_ssp(chain(tmp_path / "x.ssp", way, archive.DEPTH_LIMIT, 1)).components == ()
    (found,) = problems(chain(tmp_path / "y.ssp", way, 400, 1))
    assert "more than 32 systems inside each other; that is the limit (DEPTH_LIMIT)" in found


def test_systems_written_in_systems_have_the_same_limit(tmp_path):
    text = ""
    for _ in range(archive.DEPTH_LIMIT + 1):
        text = f'<ssd:System name="s"><ssd:Elements>{text}</ssd:Elements></ssd:System>'
    path = tmp_path / "x.ssp"
    path.write_bytes(pack({"SystemStructure.ssd": ssd(text.replace("<ssd:Elements></ssd:Elements>", ""))}))
    assert "more than 32 systems inside each other" in problems(path)[0]


def test_ssp_2_has_the_same_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 1000)
    path = chain(tmp_path / "x.ssp", "definition", levels=8, fan=10)
    with zipfile.ZipFile(path) as file:
        members = {n: file.read(n).replace(b'version="1.0"', b'version="2.0"') for n in file.namelist()}
    path.write_bytes(pack(dict(members)))
    assert any("ELEMENT_LIMIT" in text for text in check_file(path))
