"""How many elements a system may have, how deep, and what its files may unpack to."""

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


def test_the_number_of_elements_has_a_limit(tmp_path, monkeypatch):
    """All levels count: three systems with three each are twelve."""
    inner = "".join(f'<ssd:System name="i{k}"/>' for k in range(3))
    outer = "".join(f'<ssd:System name="o{k}"><ssd:Elements>{inner}</ssd:Elements></ssd:System>' for k in range(3))
    path = tmp_path / "x.ssp"
    path.write_bytes(pack({"SystemStructure.ssd": ssd(outer)}))
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 12)
    assert load_ssp(path).components == ()
    monkeypatch.setattr(archive, "ELEMENT_LIMIT", 11)
    (fault,) = problems(path)
    assert "the system has more than 11 elements; that is the limit (ELEMENT_LIMIT). Split the system" in fault
    assert check_file(path) == [fault]


def test_the_depth_of_systems_has_a_limit(tmp_path):
    begin, end = '<ssd:System name="s"><ssd:Elements>', "</ssd:Elements></ssd:System>"
    path = tmp_path / "x.ssp"
    for depth in (31, 32):
        text = begin * depth + '<ssd:System name="s"/>' + end * depth
        path.write_bytes(pack({"SystemStructure.ssd": ssd(text)}))
        if depth == 31:
            load_ssp(path)
    assert "systems are nested deeper than 32" in problems(path)[0]


ZEROS = bytes(600_000)


def nested(path: Path, count: int) -> Path:
    """Write a package with FMUs that are read, each with 600 kB of a parameter set that its component takes."""
    inner = pack({"a.ssv": ZEROS})
    names = [f"{i}.fmu" for i in range(count)]
    binding = "<ssd:ParameterBindings><ssd:ParameterBinding sourceBase='component' source='a.ssv'/>"
    elements = "".join(
        f'<ssd:Component name="c{n[0]}" source="{n}">{binding}</ssd:ParameterBindings></ssd:Component>' for n in names
    )
    path.write_bytes(pack({"SystemStructure.ssd": ssd(elements), **dict.fromkeys(names, inner)}))
    return path


def test_what_packages_inside_unpack_to_counts(tmp_path, monkeypatch):
    """Each by itself is below the limit; the fourth is not read."""
    monkeypatch.setattr(archive, "TOTAL_LIMIT", 2_000_000)
    faults = problems(nested(tmp_path / "x.ssp", 4))
    assert "x.ssp: has more than 2000000 bytes unpacked, including FMUs inside it" in faults[-1]
    assert "--unpack-limit, or package_limit of vdfmu.engine.package.archive" in faults[-1]
    with package_limit(4_000_000):
        assert not any("bytes unpacked" in text for text in problems(tmp_path / "x.ssp"))


def test_what_is_taken_into_memory_counts_each_time(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MEMORY_LIMIT", 1_500_000)
    assert "has more than 1500000 bytes of XML" in problems(nested(tmp_path / "x.ssp", 4))[-1]


def test_packages_inside_have_a_limit_in_number(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "PACKAGE_LIMIT", 3)
    faults = problems(nested(tmp_path / "x.ssp", 4))
    assert "x.ssp: has more than 3 FMUs with parameter sets; that is the limit" in faults


@pytest.mark.heavy
def test_the_option_says_what_it_expects(tmp_path):
    path = nested(tmp_path / "x.ssp", 2)
    done = {size: command("check", path, "--unpack-limit", size) for size in ("1M", "much")}
    assert "the limit is 262144" in done["1M"].stdout  # of a member: a quarter of the whole
    assert done["much"].returncode == 2
    assert "expected a size such as 500M or 4G" in " ".join(done["much"].stderr.replace("│", " ").split())
