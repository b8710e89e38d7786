"""Systems that refer to systems: how many elements and how deep, in every way of reference."""

import os
import tracemalloc
from pathlib import Path

import pytest

from tests.engine import texts
from tests.engine.files import check_file
from tests.hostile.packages import pack
from tests.system.package.problems import problems
from tests.warm import command
from vdfmu.engine.package import archive
from vdfmu.engine.package.archive import package_limit
from vdfmu.engine.package.read import load_ssp


def ssd(inside: str, rest: str = "") -> str:
    return texts.ssd(texts.elements(inside), rest)


WAYS = ["definition", "package", "id"]


def refer(count: int, source: str, way: str) -> str:
    kind = "" if way == "id" else f' type="application/x-ssp-{way}"'
    return "".join(f'<ssd:Component name="c{k}"{kind} source="{source}"/>' for k in range(count))


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


@pytest.mark.parametrize("way", WAYS)
def test_references_that_multiply_are_stopped(tmp_path, monkeypatch, way):
    """8 levels with 10 references each are 10**8 elements; the file has some hundred."""
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 1000)  # for speed
    path = chain(tmp_path / "x.ssp", way, levels=8, fan=10)
    (fault,) = problems(path)
    assert "the system has more than 1000 elements" in fault
    assert "that is the limit (ELEMENT_LIMIT). Look for systems" in fault
    assert check_file(path) == [fault]


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
    (fault,) = problems(chain(tmp_path / "y.ssp", way, 400, 1))
    assert "more than 32 systems inside each other; that is the limit (DEPTH_LIMIT)" in fault


def test_systems_written_in_systems_have_the_same_limit(tmp_path):
    text = ""
    for _ in range(archive.DEPTH_LIMIT + 1):
        text = f'<ssd:System name="s"><ssd:Elements>{text}</ssd:Elements></ssd:System>'
    path = tmp_path / "x.ssp"
    path.write_bytes(pack({"SystemStructure.ssd": ssd(text.replace("<ssd:Elements></ssd:Elements>", ""))}))
    assert "more than 32 systems inside each other" in problems(path)[0]


ZEROS = bytes(600_000)


def nested(path: Path, count: int) -> Path:
    """Write a package with packages that are read, each with 600 kB of an FMU that the system names."""
    values = "<ssd:ParameterBindings><ssd:ParameterBinding source='a.ssv'/></ssd:ParameterBindings>"
    inner = pack({"SystemStructure.ssd": ssd("").replace("</ssd:System>", f"{values}</ssd:System>"), "a.ssv": ZEROS})
    names = [f"{i}.ssp" for i in range(count)]
    elements = "".join(f'<ssd:Component name="c{n[0]}" type="application/x-ssp-package" source="{n}"/>' for n in names)
    path.write_bytes(pack({"SystemStructure.ssd": ssd(elements), **dict.fromkeys(names, inner)}))
    return path


def test_what_packages_inside_unpack_to_counts(tmp_path, monkeypatch):
    """Each by itself is below the limit; the fourth is not read."""
    monkeypatch.setattr(archive, "TOTAL_LIMIT", 2_000_000)
    faults = problems(nested(tmp_path / "x.ssp", 4))
    assert "x.ssp: has more than 2000000 bytes unpacked, including packages inside it" in faults[-1]
    assert "--unpack-limit, or package_limit of vdfmu.engine.package.archive" in faults[-1]
    with package_limit(4_000_000):
        assert not any("bytes unpacked" in text for text in problems(tmp_path / "x.ssp"))


def test_what_is_taken_into_memory_counts_each_time(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MEMORY_LIMIT", 1_500_000)
    assert "has more than 1500000 bytes of XML" in problems(nested(tmp_path / "x.ssp", 4))[-1]


def test_packages_inside_have_a_limit_in_number(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "PACKAGE_LIMIT", 3)
    assert "x.ssp: has more than 3 packages inside it; that is the limit" in problems(nested(tmp_path / "x.ssp", 4))


@pytest.mark.heavy
def test_nothing_stays_in_memory_of_a_package_inside(tmp_path):
    """30 MB inside 30 MB: neither is held, only pieces of 256 KiB with the buffers of the zip file, some MiB."""
    large = os.urandom(30_000_000)
    inner = pack({"SystemStructure.ssd": ssd(""), "large": large})
    path = tmp_path / "x.ssp"
    path.write_bytes(pack({"SystemStructure.ssd": ssd(refer(1, "in.ssp", "package")), "in.ssp": inner}))
    del large, inner
    load_ssp(path)
    tracemalloc.start()
    load_ssp(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 8 * 2**20


@pytest.mark.heavy
def test_the_option_says_what_it_expects(tmp_path):
    path = nested(tmp_path / "x.ssp", 2)
    done = {size: command("check", path, "--unpack-limit", size) for size in ("1M", "much")}
    assert "the limit is 262144" in done["1M"].stdout  # of a member: a quarter of the whole
    assert done["much"].returncode == 2
    assert "expected a size such as 500M or 4G" in " ".join(done["much"].stderr.replace("│", " ").split())
