"""A release of one arm, made twice, has the same bits."""

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib

import pytest

from tests.docs.pages import ROOT
from vdfmu.base.platforms import this_platform
from vdfmu.base.version import __version__

CONDA_NAMES = {"fmpy": "fmpy-base", "matplotlib": "matplotlib-base"}
"""Packages that conda-forge has under another name: those without windows."""


@pytest.fixture(name="release")
def _release(monkeypatch, tmp_path):
    """Give the module `release`, for a tree of which only texts are there."""
    spec = importlib.util.spec_from_file_location("release", ROOT / "release.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.problems(final=False) == []
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return module


def test_version_changelog_citation_and_commit_agree(release, tmp_path):
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [9.0.0] - unreleased\n")
    (tmp_path / "CITATION.cff").write_text("version: 9.0.0\n")
    (problem,) = release.problems(final=False)
    assert problem == (
        f"CHANGELOG.md: expected [{__version__}] as its newest version, as vdfmu has it, got [9.0.0] - unreleased."
    )
    release.__dict__["__version__"] = "9.0.0"
    assert release.problems(final=False) == []

    def git(*arguments):
        who = ["-c", "user.name=n", "-c", "user.email=e"]
        subprocess.run(["git", *who, *arguments], cwd=tmp_path, check=True, capture_output=True)

    git("init")
    git("commit", "--allow-empty", "-m", "Begin")
    undated, changed, tag = release.problems(final=True)
    assert undated.startswith("CHANGELOG.md: expected the date of the release") and "got unreleased" in undated
    assert "changed or further files: ?? CHANGELOG.md" in changed
    assert tag == "git: expected the tag v9.0.0 at this commit."

    def commit():
        git("add", ".")
        git("commit", "-m", "Release")
        git("tag", "-f", "v9.0.0")

    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [9.0.0] - 2027-01-31\n")
    commit()
    assert release.problems(final=True) == [
        "CITATION.cff: expected date-released: 2027-01-31, as the changelog has it."
    ]
    (tmp_path / "CITATION.cff").write_text("version: 9.0.0\ndate-released: 2027-01-31\n")
    commit()
    assert release.problems(final=True) == []


def test_the_recipe_of_conda_renders_and_has_what_pyproject_says():
    from rattler_build import Stage0Recipe

    (variant,) = Stage0Recipe.from_file(ROOT / "conda" / "recipe.yaml").render()
    recipe = variant.recipe.to_dict()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    said = project["project"]

    def named(requirements):
        split = [(name, f"{sign}{bound}") for name, sign, bound in (each.partition(">=") for each in requirements)]
        return [f"{CONDA_NAMES.get(name, name)} {bound}" for name, bound in split]

    assert recipe["package"] == {"name": said["name"], "version": __version__}
    assert recipe["requirements"]["run"] == named([f"python{said['requires-python']}", *said["dependencies"]])
    assert {*named(project["build-system"]["requires"])} <= set(recipe["requirements"]["host"])
    entries = [f"{name} = {place}" for name, place in said["scripts"].items()]
    assert recipe["build"]["noarch"] == "python" and recipe["build"]["python"]["entry_points"] == entries
    assert (recipe["about"]["summary"], recipe["about"]["license"]) == (said["description"], said["license"])


@pytest.fixture(scope="module", name="releases")
def _releases(tmp_path_factory):
    """Make a release of one arm twice; return its folders."""
    folder = tmp_path_factory.mktemp("releases")
    for name in ("one", "two"):
        command = [sys.executable, "release.py", "--only", "planar_2dof", "--platform", this_platform()]
        subprocess.run([*command, "--out", str(folder / name)], cwd=ROOT, check=True, capture_output=True)
    return folder / "one", folder / "two"


@pytest.mark.heavy
def test_a_release_made_twice_has_the_same_bits(releases):
    first, second = releases
    sums = (first / "SHA256SUMS").read_text()
    assert sums == (second / "SHA256SUMS").read_text()
    digests = {name: digest for digest, name in (line.split("  ") for line in sums.splitlines())}
    assert digests == {name: hashlib.sha256((first / name).read_bytes()).hexdigest() for name in digests}
    assert len([name for name in digests if name.endswith(".fmu")]) == 10  # five units in two versions of FMI
    sdist = f"vdfmu-{__version__}.tar.gz"
    assert len([name for name in digests if name.endswith(".whl")]) == 2
    whole = {sdist, f"vdfmu-{__version__}-py3-none-any.whl", "LICENSE", "README.md", "recipe.yaml", "constraints.txt"}
    assert whole | {"planar_2dof/reference/planar_2dof_reach_2.0.ssp"} <= digests.keys()
    recipe = (first / "recipe.yaml").read_text()
    assert f"path: {sdist}\n  sha256: {digests[sdist]}\n" in recipe and "path: .." not in recipe


@pytest.mark.heavy
def test_the_first_run_of_its_wheel_for_this_platform_traces_and_compiles_nothing(releases, tmp_path):
    (wheel,) = releases[0].glob("*linux*.whl")
    site, environment = tmp_path / "site", os.environ | {"VDFMU_CACHE_DIR": str(tmp_path / "cache")}
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-compile", "--target", str(site), str(wheel)]
    subprocess.run([sys.executable, *install], check=True)

    def first_run(name):
        """Run the tracking scenario with an empty cache; return what it says and writes."""
        run = [sys.executable, "-m", "vdfmu.cli", "run", "tracking", "--stop", "0.5", "--verbose", "--out", name]
        environment["PYTHONPATH"] = str(site)
        done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        shutil.rmtree(tmp_path / "cache")
        return done.stderr, (tmp_path / name / "results.csv").read_bytes()

    said, results = first_run("brought")
    assert "zig cc" not in said and "from the cache: native" in said
    shutil.rmtree(site / "vdfmu" / "_data" / "prebuilt")
    said, made_here = first_run("made")
    assert "zig cc" in said and results == made_here
