"""The documentation as it is built: the page of the Python API, links, versions, and pages on a phone."""

import html
import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vdfmu
from tests.docs.pages import loaded as loaded_versions
from tests.study.page.browser import Browser

pytestmark = pytest.mark.heavy
ROOT = Path(__file__).resolve().parents[2]


VERSIONS = loaded_versions()


def pages_of(site):
    return [site / page for page in VERSIONS.pages_of(site)]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the pages of version 0.1, beside one of 0.2, from a build that stops at any warning."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(ROOT / "docs", folder / "docs")
    shutil.copytree(ROOT / "ssp", folder / "ssp")
    shutil.copy(ROOT / "zensical.toml", folder)
    shutil.copy(ROOT / "CHANGELOG.md", folder)
    (folder / "vdfmu").symlink_to(ROOT / "vdfmu")
    done = subprocess.run(
        [sys.executable, "docs/make.py", "--name", "0.1"], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    built = folder / "site/0.1"
    assert {path.name for path in (built / "live").iterdir()} == {"tracking.html", "wall.html"}
    pages = pages_of(built)
    assert len(pages) > 30
    for page in pages:  # nothing comes from a network, and the search has its worker beside it
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'(?:src|<link[^>]* href)="([^"]+)"', text)
        assert [url for url in loaded if re.match(r"\w+://|//", url)] == [], page
        (shim,) = (url for url in loaded if url.endswith("js/iframe-worker.js"))
        assert (page.parent / shim).exists()
    later = shutil.copytree(folder / "build/site", folder / "build/later")
    (later / "plugins.html").unlink()
    VERSIONS.add_version(later, folder / "site", "0.2")
    return built


@pytest.fixture(scope="module")
def api(site):
    return "".join(page.read_text(encoding="utf-8") for page in sorted(site.glob("reference/api_*.html")))


def documented(function):
    text = (inspect.getdoc(function) or "").partition("Parameters\n---")[2]
    text = re.split(r"\n\w+\n---", text)[0]
    kinds = {}
    for line in re.findall(r"^[\w*, ]+(?: : .*)?$(?=\n +)?", text.replace(",\n", ", "), re.MULTILINE):
        names, _, kind = line.partition(" : ")
        kinds |= {name.strip("* "): kind for name in names.split(",")}
    return kinds


PUBLIC = [getattr(vdfmu, name) for name in vdfmu.__all__] + [
    getattr(vdfmu.dynamics, name) for name in vdfmu.dynamics.__all__
]


@pytest.mark.parametrize("function", [*filter(inspect.isfunction, PUBLIC)], ids=lambda function: function.__name__)
def test_a_public_function_documents_its_parameters_and_what_it_returns(function):
    signature, text = inspect.signature(function), inspect.getdoc(function)
    assert set(documented(function)) >= set(signature.parameters)
    for parameter, kind in documented(function).items():  # a time has its unit
        assert parameter not in ("step", "stop", "start", "time_limit") or not kind or "[s]" in kind, parameter
    if signature.parameters and "Generator" not in str(signature.return_annotation):
        assert "Returns\n-------" in text and (
            "Raises\n------" in text or re.search("errors as of|with its errors|errors: see", text)
        )


@pytest.mark.parametrize("name", [public.__name__ for public in PUBLIC if not inspect.ismodule(public)])
def test_every_public_name_is_on_the_page_of_the_api(api, name):
    assert re.search(rf'<h3 id="[\w.]*\.{name}"', api)


def test_every_link_and_picture_of_the_pages_leads_somewhere(site):
    pages = {page: page.read_text(encoding="utf-8") for page in pages_of(site)}
    places = {page: set(re.findall(r'\b(?:id|name)="([^"]+)"', text)) for page, text in pages.items()}
    for page, text in pages.items():
        for url in re.findall(r'\b(?:href|src)="([^"]+)"', text):
            name, _, place = html.unescape(url).partition("#")
            if not re.match(r"\w+:", name):
                target = (page.parent / name).resolve() if name else page
                assert target.exists(), (page.name, url)
                assert not place or target not in places or place in places[target] | {"__skip"}, (page.name, url)


def test_drawings_are_those_of_their_code(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    number = re.compile(r"-?\d+\.?\d*")
    for name, drawn in importlib.import_module("pictures").PICTURES.items():
        made, kept = drawn(), (ROOT / f"docs/images/{name}.svg").read_text(encoding="utf-8")
        assert number.sub("0", made) == number.sub("0", kept), name
        # Places have four digits, in px below 1000: the last, 0.1, may round otherwise on another processor.
        places = [[float(x) for x in number.findall(text)] for text in (made, kept)]
        assert places[0] == pytest.approx(places[1], abs=0.11), name


NARROW = """(() => {
    const wide = e => e.getBoundingClientRect().right > innerWidth + 1
    const boxed = e => e.parentElement && (getComputedStyle(e).overflowX !== "visible" || boxed(e.parentElement))
    return {
        width: document.documentElement.scrollWidth,
        beyond: [...document.querySelectorAll(".md-content *")].filter(e => wide(e) && !boxed(e)).map(e => e.outerHTML),
        broken: [...document.images].filter(e => !e.naturalWidth).map(e => e.src),
        shrunk: [...document.querySelectorAll("svg.formula")].filter(e => e.getBoundingClientRect().height
            < 0.84 * e.getAttribute("height")).map(e => e.getAttribute("aria-label")),
    }
})()"""


def test_every_page_is_readable_on_a_phone(site, tmp_path):
    """Nothing is beyond the edge but in a box that scrolls; formulas keep their size, in tables that of its text."""
    with Browser(tmp_path) as browser:
        for page in pages_of(site):
            browser.open(page, 390, 800)
            widths = browser.run(NARROW)
            assert widths == {"width": 390, "beyond": [], "broken": [], "shrunk": []}, page
            assert browser.run("document.styleSheets.length") > 2, page
        assert browser.problems == []
        assert [url for url in browser.requests if not url.startswith(("file:", "data:", "blob:"))] == []


SELECTOR = """new Promise(done => {
    const look = () => {
        const links = [...document.querySelectorAll(".md-version__list a")].map(a => a.href)
        if (links.length) done([document.querySelector(".md-version__current").textContent, document.title, ...links])
        else setTimeout(look, 50)
    }
    look()
})"""


def test_each_page_says_its_version_and_leads_to_the_same_page_of_others(site, tmp_path):
    at = site.parent.as_uri()
    with Browser(tmp_path) as browser:
        for version, page, there in (
            ("0.1", "tutorials/own_arm.html", "tutorials/own_arm.html"),
            ("0.2", "native.html", "native.html"),
            ("0.1", "plugins.html", "index.html"),  # which 0.2 does not have
        ):
            browser.open(site.parent / version / page)
            said, title, *links = browser.run(SELECTOR)
            assert (said, title.endswith(f" - vdfmu {version}")) == (version, True)
            assert links == [f"{at}/0.2/{there}", f"{at}/0.1/{page}"]
        assert browser.problems == []
    (first,) = re.findall(r'url=([^"]+)"', (site.parent / "index.html").read_text(encoding="utf-8"))
    assert first == "0.2/index.html" and (site.parent / first).exists()
