"""The page of a folder of results: a card for each run."""

import json
import re
import shutil
from datetime import UTC, datetime

import numpy as np
import pytest
from click.testing import CliRunner

import vdfmu
from tests.study.page.browser import show
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import quantity
from vdfmu.cli import runs
from vdfmu.cli.commands import app
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import line_of
from vdfmu.study.report.gallery import gallery_page, is_gallery, seen_along, write_gallery
from vdfmu.study.report.shapes import Chain
from vdfmu.study.report.shown_run import read_run


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


def cards(page: bytes) -> list[str]:
    return re.findall(r"<li data-name.*?</li>", page.decode(), re.DOTALL)


def test_each_run_has_a_card_with_its_verdict_numbers_and_a_link(results):
    summary = read_run(results / "first run").summary
    assert is_gallery(results) and not is_gallery(results / "package")
    (card,) = (card for card in cards(gallery_page(results)) if 'data-name="first run"' in card)
    errors = summary["max_position_error_deg"]
    worst = int(np.argmax(errors))
    assert f'<p class="good">{line_of(summary)}</p>' in card and 'href="first%20run/report.html"' in card
    assert f"joint {worst + 1} worst, {quantity(errors[worst], 'deg')}" in card
    assert "planar_tracking on planar_2dof" in card


def test_the_picture_has_the_path_of_the_tool(results):
    run = read_run(results / "first run")
    (card,) = (card for card in cards(gallery_page(results)) if 'class="path"' in card)
    start, end, path = (
        np.array([list(map(float, point.split())) for point in points.split("L")])
        for points in re.findall(r'class="(?:arm start|arm|path)" d="M(.*?)"', card)
    )
    assert len(path) == 40 and (path[0] == start[-1]).all() and (path[-1] == end[-1]).all()
    chain = Chain(run.summary["arm"])
    points = np.array([chain.points(row) for row in run.results["plant.q"][[0, -1]]])
    drawn = np.array([start, end])
    frames = np.column_stack([points.reshape(-1, 3), np.ones(points.size // 3)])
    projection, *_ = np.linalg.lstsq(frames, drawn.reshape(-1, 2))
    # one affine map of the frames of the links gives both arms; numbers have one digit after the point
    np.testing.assert_allclose(frames @ projection, drawn.reshape(-1, 2), atol=0.1)


def test_other_forms_of_results_have_the_same_picture(results):
    before = cards(gallery_page(results))
    file = results / "first run" / "results.csv"
    Results.read(file).write(file.with_suffix(".parquet"))
    file.unlink()
    pictures = [[float(v) for v in re.findall(r"-?\d+\.\d", "".join(re.findall("<svg.*?</svg>", card)))]
                for each in (before, cards(gallery_page(results))) for card in each if "first run" in card]  # fmt: skip
    assert pictures[0] and len(pictures[0]) == len(pictures[1])
    # rows of a file of text are those after equal numbers of bytes, not of rows: a row of 300 is 0.3 % of the picture
    assert np.abs(np.subtract(*pictures)).max() < 0.05 * 320


def test_what_is_deleted_is_gone_and_what_cannot_be_read_is_named(results):
    (results / "torn").mkdir()
    (results / "torn" / "summary.json").write_text('{"scenario": ')
    page = gallery_page(results).decode()
    assert "Not shown: torn: " in page and len(cards(page.encode())) == 2
    shutil.rmtree(results / "package")
    assert len(cards(gallery_page(results))) == 1


def test_a_failed_check_is_seen_and_counted(results):
    file = results / "first run" / "summary.json"
    summary = json.loads(file.read_text())
    for state, rank in (("doubtful", -1), ("failed", -2)):
        summary["verdict"] |= {"state": state, "words": "off its path"}
        file.write_text(json.dumps(summary))
        page = gallery_page(results)
        assert f"2 runs: 1 {state}" in page.decode()
        (card,) = (one for one in cards(page) if f'data-verdict="{rank}"' in one)
        assert f'<p class="{state}">{state.capitalize()}: off its path</p>' in card


def test_the_command_writes_it(results, tmp_path):
    done = CliRunner().invoke(app, ["report", str(results)])
    assert done.exit_code == 0 and (results / "index.html").exists(), done.output
    done = CliRunner().invoke(app, ["report", str(results), "--out", str(tmp_path / "all.html")])
    assert done.exit_code == 0 and b'href="results/first%20run/report.html"' in (tmp_path / "all.html").read_bytes()


@pytest.mark.parametrize("damage", [b"\xff\xfe,", b"a text,"])
def test_results_that_cannot_be_read_are_named_and_the_others_shown(results, damage):
    file = results / "first run" / "results.csv"
    head, units, *rows = file.read_bytes().splitlines()
    rows = [
        damage + b",".join(row.split(b",")[1:]) if damage[0] == 255 else damage * row.count(b",") + b"1" for row in rows
    ]
    file.write_bytes(b"\n".join([head, units, *rows]) + b"\n")
    page = gallery_page(results)
    (card,) = (card for card in cards(page) if 'data-name="first run"' in card)
    assert "Results cannot be read: " in card and ">F</text>" in card and len(cards(page)) == 2
    assert CliRunner().invoke(app, ["report", str(results)]).exit_code == 0


def test_the_arm_is_seen_from_above_as_on_the_page():
    for up in ([0, 0, 1], [0, 0, -1], [0, 1, 0], [0.6, 0, 0.8]):
        right, above = seen_along(np.array(up, dtype=float))
        eye = np.cross(right, above)
        # rounding of unit vectors
        np.testing.assert_allclose([np.dot(right, up), np.dot(right, above), np.dot(eye, eye)], [0, 0, 1], atol=1e-12)
        assert np.dot(eye, up) == pytest.approx(0.62 / np.linalg.norm([0.95, -1.25, 0.62]))  # above the floor
        assert np.dot(above, up) > 0
    right, above = seen_along(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.cross(right, above) @ [0.95, -1.25, 0.62], np.linalg.norm([0.95, -1.25, 0.62]))


def test_the_date_is_that_of_the_run(results):
    file = results / "first run" / "summary.json"
    summary = json.loads(file.read_text()) | {"date": "2020-02-03T04:05:06+00:00"}
    file.write_text(json.dumps(summary))
    (card,) = (card for card in cards(gallery_page(results)) if 'data-name="first run"' in card)
    stamp = datetime(2020, 2, 3, 4, 5, 6, tzinfo=UTC).timestamp()
    assert "2020-02-03 04:05 UTC" in card and f'data-date="{stamp}"' in card


def test_a_failed_run_has_a_page_and_a_card(results, monkeypatch):
    monkeypatch.chdir(results.parent)
    words = ["run", "planar_tracking", "--set", "controller.K_p=1e9", "--stop", "0.05", "--out", "results/failed"]
    done = CliRunner().invoke(app, words)
    page = results / "failed" / "partial" / "report.html"
    assert done.exit_code == 1 and page.exists()
    *_, said, last = done.output.splitlines()
    assert last == "Open results/failed/partial/report.html", done.output
    assert said.startswith("error: plant failed at t =") and "unstable from the start" in said
    (card,) = (card for card in cards(gallery_page(results)) if 'data-name="failed/partial"' in card)
    assert 'class="failed">Failed: unstable from the start' in card and 'href="failed/partial/report.html"' in card
    page.unlink()
    assert not is_gallery(results / "failed")
    assert CliRunner().invoke(app, ["report", "results/failed", "--no-simulate"]).exit_code == 0 and page.exists()
    assert "report.html" in json.loads((page.parent / "summary.json").read_text())["files"]


def test_a_file_of_others_is_not_replaced(results):
    (results / "index.html").write_text("<p>mine</p>")
    (results / "keep.csv").write_text("mine")
    for words in (
        [results],
        [results, "-o", results / "keep.csv"],
        [results / "first run", "-o", results / "keep.csv"],
    ):
        done = CliRunner().invoke(app, ["report", "--no-simulate", *map(str, words)])
        assert isinstance(done.exception, UsageError) and "replace it with --overwrite" in str(done.exception)
    assert (results / "index.html").read_text() == "<p>mine</p>" and (results / "keep.csv").read_text() == "mine"
    for words in (["--overwrite"], []):  # the second time it is ours
        assert CliRunner().invoke(app, ["report", str(results), *words]).exit_code == 0


def test_the_page_of_several_is_opened(results, monkeypatch):
    opened = []
    monkeypatch.setattr(runs.webbrowser, "open", lambda address: opened.append(address) or True)
    done = CliRunner().invoke(app, ["report", str(results), "--open"])
    assert opened == [(results / "index.html").as_uri()] and f"Open {results / 'index.html'}" in done.output


@pytest.mark.heavy
def test_cards_are_sorted_and_found(results, browser, quiet):
    show(browser, write_gallery(results))
    names = "[...document.querySelectorAll('.gallery li')].filter(e => !e.hidden).map(e => e.dataset.name)"
    assert browser.run(names) == ["package", "first run"]
    choose = "(k => { const s = document.getElementById('sort'); s.value = k; s.dispatchEvent(new Event('input')) })"
    browser.run(f"{choose}('name')")
    assert browser.run(names) == ["first run", "package"]
    browser.run("(f => { f.value = 'pack'; f.dispatchEvent(new Event('input')) })(document.getElementById('find'))")
    assert browser.run(names) == ["package"]
    assert browser.run("document.getElementById('count').textContent") == "1 of 2"
