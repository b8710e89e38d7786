"""What is installed: versions that were tested together, named without a place to get them from."""

import importlib.util
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def locked(name: str) -> list[str]:
    """Return the lines of a file of `requirements` and of those that it includes, continued ones joined."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    return [
        line
        for entry in text.splitlines()[1:]
        for line in (locked(entry[3:].removesuffix(".txt")) if entry.startswith("-r ") else [entry])
    ]


def names(entries: list[str]) -> set[str]:
    return {re.split(r"[\[<>=; ]", entry)[0].lower().replace("_", "-") for entry in entries} - {"vdfmu"}


def test_every_constraint_is_a_name_and_a_version():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:]
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9.-]*==[0-9][0-9a-z.]*", line) for line in lines)
    assert lines == sorted(lines)
    assert len(names(lines)) == len(lines)  # two versions of one, for two Pythons, would fit none


FILES = sorted(path.stem for path in (ROOT / "requirements").glob("*.txt"))


@pytest.mark.parametrize("name", FILES)
def test_every_package_has_the_tested_version_and_hashes_and_no_place(name):
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:]
    marker = "[a-z_]+ [<>=!]+ '[A-Za-z0-9_.]+'"
    for line in locked(name):
        match = re.fullmatch(
            rf"(\S+==\S+)( ; [()]*{marker}[()]*( (and|or) [()]*{marker}[()]*)*)?( +--hash=sha256:[0-9a-f]{{64}})+", line
        )
        assert match, line
        assert match[1] in constraints


def test_the_files_have_all_that_the_project_names():
    base = names([*PROJECT["build-system"]["requires"], *PROJECT["project"]["dependencies"]])
    extras = PROJECT["project"]["optional-dependencies"]
    assert {"base", "native", "docs", "dev", "test", "supply"} == set(FILES)
    for name in {"base", *extras} - {"notebook"}:
        assert base | names(extras.get(name, [])) <= names(locked(name if name in FILES else "test")), name
    assert names(PROJECT["dependency-groups"]["supply"]) <= names(locked("supply"))
    constraints = names((ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:])
    assert set().union(names(extras["notebook"]), *(names(locked(name)) for name in FILES)) <= constraints
    # make test-lowest reads it from this line
    assert (
        re.findall(r'^requires = \["(.*)"\]$', (ROOT / "pyproject.toml").read_text("utf-8"), re.MULTILINE)
        == (PROJECT["build-system"]["requires"])
    )


def built(target: str, folder: Path) -> Path:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (file,) = folder.iterdir()
    return file


@pytest.mark.heavy
def test_the_sdist_has_every_file_of_the_project(tmp_path):
    with tarfile.open(built("sdist", tmp_path)) as archive:
        packed = {each.name.partition("/")[2] for each in archive if each.isfile()} - {"PKG-INFO"}
    git = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    if (ROOT / "PKG-INFO").exists():  # unpacked from an sdist, where git knows no files
        assert {"tests/docs/test_supply.py", "examples/units/wall.py", "hatch_build.py"} <= packed
        return
    listed = subprocess.run(git, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    assert packed == {name for name in listed if (ROOT / name).is_file()}


@pytest.mark.heavy
def test_the_readme_of_an_index_has_no_link_that_leads_nowhere(tmp_path):
    with zipfile.ZipFile(built("wheel", tmp_path)) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("dist-info/METADATA"))
        text = archive.read(name).decode()
        assert "vdfmu/py.typed" in archive.namelist()
    assert "# vdfmu\n" in text and "vdfmu run tracking" in text
    assert 'pip install "vdfmu[native]"' in text and "constraints.txt" not in text  # which are in a clone
    targets = re.findall(r"\]\(([^)]*)\)", text)
    assert all(target.startswith("https://") for target in targets)


def test_links_of_the_readme_follow_the_address_of_the_project():
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec and spec.loader
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    text = "A ![loop](docs/a.svg), [model](docs/model.md#errata) and [FMI](https://fmi-standard.org)."
    assert hook.for_index(text, "", "1.0") == "A , model and [FMI](https://fmi-standard.org)."
    assert hook.for_index(text, "https://host/x", "1.0") == (
        "A ![loop](https://host/x/raw/v1.0/docs/a.svg), [model](https://host/x/blob/v1.0/docs/model.md#errata) "
        "and [FMI](https://fmi-standard.org)."
    )


def test_make_installs_nothing_without_a_hash():
    lines = re.findall(r"\$\(PIP_INSTALL\) (.*)", (ROOT / "Makefile").read_text(encoding="utf-8"))
    without = {line for line in lines if not line.startswith("--require-hashes -r ")}
    assert len(lines) > 3 and without == {"--no-deps --no-build-isolation -e ."}
