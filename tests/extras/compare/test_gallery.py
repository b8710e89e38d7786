"""The page of a folder of results: a link to each run, with its verdict."""

import json
import os
import re
import shutil

import pytest

import vdfmu
from tests.conftest import ran, refused
from tests.study.page.browser import show
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.verdict import headline_of
from vdfmu.extras.compare.gallery import gallery_page, write_gallery
from vdfmu.study.report.shown_run import is_gallery, read_run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a folder of results with one run of an arm, and one of another tool's package, without an arm."""
    folder = tmp_path_factory.mktemp("results")
    vdfmu.run("planar_tracking", stop=0.3, out=folder / "first run", reference=False)
    package = folder / "first run" / "system.ssp"
    run_system(package, stop=0.05, out=folder / "package")
    return folder


@pytest.fixture
def results(made, tmp_path):
    return shutil.copytree(made, tmp_path / "results")


def rows(page: bytes) -> dict[str, str]:
    """Return the rows of the list by the names of the runs."""
    listed = re.findall(r'<tr><td><a href=".*?</tr>', page.decode())
    return {re.search(r">([^<>]+)</a>", row)[1]: row for row in listed}


def changed(folder, **facts):
    """Give the summary of a run other facts."""
    file = folder / "summary.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | facts))


def test_each_run_has_a_link_and_its_verdict(results):
    summary = read_run(results / "first run").summary
    assert is_gallery(results) and not is_gallery(results / "package")
    row = rows(gallery_page(results, results))["first run"]
    assert (
        f'<span class="verdict good">{headline_of(summary)}</span>' in row and 'href="first%20run/report.html"' in row
    )
    assert "planar_tracking on planar_2dof" in row
    assert 'href="package"' in rows(gallery_page(results, results))["package"]  # it has no page


def test_broken_folders_are_named_and_deleted_ones_are_gone(results):
    for name, text in {"torn": '{"scenario": ', "other": "[]", "text": '{"verdict": "good"}'}.items():
        (results / name).mkdir()
        (results / name / "summary.json").write_text(text)
    (results / "pipe").mkdir()
    os.mkfifo(results / "pipe" / "summary.json")
    page = gallery_page(results, results)
    for name in ("torn", "other", "text", "pipe"):
        assert page.decode().count(f"<p class=note>Not shown: {name}: ") == 1
    assert rows(page).keys() == {"first run", "package"}
    shutil.rmtree(results / "package")
    assert rows(gallery_page(results, results)).keys() == {"first run"}


def test_nothing_but_the_summary_is_opened_whose_names_and_verdicts_are_text(results):
    """Results, package and page may be anything, even pipes that never end."""
    whole = rows(gallery_page(results, results))
    for name in ("results.csv", "system.ssp"):
        (results / "first run" / name).unlink()
        os.mkfifo(results / "first run" / name)
    (results / "first run" / "report.html").write_text("<script>alert(1)</script>")
    assert rows(gallery_page(results, results)) == whole
    wild = results / "<b>&'\udcff"
    (results / "package").rename(wild)
    changed(wild, system="<i>x</i>", verdict={"state": "failed", "headline": "<u>w</u>", "results": "", "checks": []})
    page = gallery_page(results, results).decode()
    assert "&lt;i&gt;x&lt;/i&gt;" in page and "&lt;u&gt;w&lt;/u&gt;" in page and "&lt;b&gt;" in page
    assert not re.search("<[biu]>", page) and 'href="%3Cb%3E%26%27%FF"' in page


def test_a_verdict_is_seen_and_counted(results):
    for state in ("doubtful", "failed"):
        changed(
            results / "first run", verdict={"state": state, "headline": "off its path", "results": "", "checks": []}
        )
        page = gallery_page(results, results)
        assert f"2 runs: 1 {state}" in page.decode()
        assert f'<span class="verdict {state}">off its path' in rows(page)["first run"]


def test_the_newest_run_is_first_and_the_command_writes_the_list(results, tmp_path):
    for first, date in (("package", "2020-02-03T04:05:06+00:00"), ("first run", "2099-02-03T04:05:06+00:00")):
        changed(results / "first run", date=date)
        page = gallery_page(results, results)
        assert next(iter(rows(page))) == first and f"{date[:10]} 04:05 UTC" in rows(page)["first run"]
    ran("report", results)
    assert (results / "index.html").exists()
    ran("report", results, "--out", tmp_path / "all.html")
    assert b'href="results/first%20run/report.html"' in (tmp_path / "all.html").read_bytes()


@pytest.mark.heavy
def test_a_click_on_a_heading_sorts_by_numbers_and_a_second_click_turns_the_order(results, browser, quiet, tmp_path):
    for name, margin in {"nine": 0.9, "tenth": 0.1, "small": 3e-7}.items():
        shutil.copytree(results / "first run", results / name)
        figure = {"value": margin, "joint": 1, "place": "joint 1", "at_s": 0.0}
        changed(results / name, key_figures={"margin": figure})
    shutil.rmtree(results / "first run")
    show(browser, write_gallery(results, tmp_path / "index.html"), 1280, 800)
    names = "[...document.querySelectorAll('table tr td:first-child')].map(e => e.textContent)"
    button = "[...document.querySelectorAll('th button')].find(e => e.textContent === 'modulus margin')"
    for order, expected in (("ascending", ["small", "tenth", "nine"]), ("descending", ["nine", "tenth", "small"])):
        browser.run(f"{button}.click()")
        assert browser.run(names) == [*expected, "package"]  # which has no margin
        assert browser.run(f"{button}.parentElement.getAttribute('aria-sort')") == order


def test_the_list_has_key_figures_as_numbers(results):
    figure = read_run(results / "first run").summary["key_figures"]["margin"]
    page = gallery_page(results, results)
    assert b"<th>modulus margin</th>" in page and b"<th>date</th></tr>" in page
    assert f'<data value="{figure["value"]!r}">' in rows(page)["first run"]
    assert rows(page)["package"].count("<td></td>") == page.decode().count("<th>") - 4  # link, verdict, system, date


def test_a_failed_run_has_a_page_and_a_row(results, monkeypatch):
    monkeypatch.chdir(results.parent)
    words = ["run", "planar_tracking", "--set", "controller.K_p=1e9", "--stop", "0.05", "--out", "results/failed"]
    done = ran(*words, code=1)
    page = results / "failed" / "partial" / "report.html"
    assert page.exists()
    *_, said, last = done.output.splitlines()
    assert last == "Open results/failed/partial/report.html", done.output
    assert said.startswith("error: plant failed at t =") and "Unstable from the start" in said
    headline = headline_of(
        read_run(page.parent).summary
    )  # the same in the terminal, the list, the page and the summary
    assert headline.startswith("Failed: unstable from the start") and f"✗ {headline}" in done.output
    row = rows(gallery_page(results, results))["failed/partial"]
    assert f'failed">{headline}' in row and 'href="failed/partial/report.html"' in row
    page.unlink()
    assert not is_gallery(results / "failed")
    ran("report", "results/failed", "--no-simulate")
    assert page.exists()
    assert "report.html" in json.loads((page.parent / "summary.json").read_text())["files"]


def test_a_file_of_others_is_not_replaced(results):
    (results / "index.html").write_text("<p>mine</p>")
    (results / "keep.csv").write_text("mine")
    for words in (
        [results],
        [results, "-o", results / "keep.csv"],
        [results / "first run", "-o", results / "keep.csv"],
    ):
        assert "replace it with --overwrite" in refused("report", "--no-simulate", *words)
    assert (results / "index.html").read_text() == "<p>mine</p>" and (results / "keep.csv").read_text() == "mine"
    for words in (["--overwrite"], []):  # the second time it is ours
        ran("report", results, *words)
