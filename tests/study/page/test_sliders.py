"""The panel that simulates: sliders, what they change in the figures, the arm and the tables, and what goes wrong."""

import re
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import Browser, calm, centre, show
from vdfmu.base.errors import CosimError
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.results import Results
from vdfmu.study.report.page import write_report
from vdfmu.study.report.shown_run import read_run

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
EQUAL = 1e-9
"""rad; the same operations in the same order, but sin, cos and tanh of another library: seen 1e-15."""
DONE = "while (report.simulation.busy) await new Promise((done) => setTimeout(done, 10));"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sliders")
    vdfmu.run("tracking", stop=1.0, out=folder, parameters={"trajectory.T": 1.0}, reference=False)
    write_report([read_run(folder)], folder / "report.html", simulate=True)
    return folder


def opened(browser: Browser, page: Path, *size: int, **more: str) -> None:
    show(browser, page, *size, **more)
    centre(browser, "#simulate")
    browser.run(f"(async () => {{ while (!document.querySelector('#found li')) await 0; {DONE} }})()".replace(
        "await 0", "await new Promise((done) => setTimeout(done, 10))"
    ))  # fmt: skip
    browser.settle()


def slide(browser: Browser, words: str, place: int, joint: int = 0) -> None:
    browser.run(f"""(async () => {{
        const row = report.simulation.sliders.find(({{ parameter }}) => parameter.words.startsWith({words!r})).element;
        const select = document.querySelector("[aria-label='Joint of the sliders']");
        const slider = row.querySelector("input");
        select.value = {joint};
        select.dispatchEvent(new Event("change"));
        slider.value = {place};
        slider.dispatchEvent(new Event("input"));
        {DONE}
    }})()""")
    browser.settle()


def words_of(browser: Browser, selector: str) -> str:
    return browser.run(f"document.querySelector({selector!r}).innerText")


def simulated(browser: Browser, figure: int) -> np.ndarray:
    return np.array(browser.run(f"""(() => {{
        const last = report.runs.length - 1;
        const curves = report.charts[{figure}].curves().filter(({{ run }}) => run === last);
        return curves.map(({{ values }}) => Array.from(values));
    }})()"""))  # fmt: skip


def test_the_pages_own_run_equals_the_recorded_one(run, browser):
    opened(browser, run / "report.html")
    assert 0 <= browser.run("report.simulation.apart") < EQUAL
    verdict = words_of(browser, "#found li")
    assert verdict.startswith("good") and "limit 1e-9 rad" in verdict
    assert "1 s simulated in" in words_of(browser, "#simulate [role=status]")
    # it is not drawn over itself
    assert browser.run("report.player.scene.puppets.length") == 1
    assert browser.run("document.querySelector('.chip.second').hidden")
    # nor saved: six joints and the time, by the names of run and figure
    heads = browser.run("report.FILES.CSV(report.charts[0]).text()").splitlines()[0].split(",")
    assert heads == ["time [s]", *(f'"joint {i} [deg]"' for i in range(1, 7))]
    browser.run("""(async () => {
        HTMLAnchorElement.prototype.click = function () { globalThis.kept = this.download; };
        const menu = document.querySelector("select.save");
        menu.value = "CSV";
        menu.dispatchEvent(new Event("change"));
        while (!globalThis.kept) await new Promise((done) => setTimeout(done, 10));
    })()""")
    assert browser.run("kept") == "tracking_position_tracking_errors.csv"
    assert browser.run("document.querySelectorAll('.tile.worse, .tile.better').length") == 0


def test_a_run_that_differs_says_what_may_be_why_and_what_was_not_in_sight_is_printed(run, browser):
    opened(browser, run / "report.html")
    browser.run(f"""(async () => {{
        report.runs[0].simulation.recorded.limit = -1;
        document.querySelector('#simulate button').click();
        {DONE}
    }})()""")
    verdict = words_of(browser, "#found li")
    assert verdict.startswith("failed") and "Without a reference" in verdict
    show(browser, run / "report.html")
    drawn = "report.charts.map(chart => chart.place.querySelector('canvas') !== null)"
    assert not all(browser.run(drawn))
    browser.call("Page.printToPDF")
    assert all(browser.run(drawn))


def test_a_slider_draws_the_run_of_the_fmus_with_that_value(run, browser):
    opened(browser, run / "report.html", 1280, 2600)
    tiles = "[...document.querySelectorAll('.tile b')].map(e => e.textContent)"
    before = browser.run(tiles)
    slide(browser, "Proportional", -50)  # 0.1 to the power of one half, in three digits
    assert words_of(browser, ".slider output") == "× 0.316"
    factor = {"controller.K_p": [0.316 * k for k in browser.run("report.simulation.sliders[0].parameter.values")]}
    other = vdfmu.run(
        "tracking", stop=1.0, out=run / "other", parameters={"trajectory.T": 1.0, **factor}, reference=False
    )
    error = np.degrees(other["trajectory.q_d"] - other["plant.q"])
    np.testing.assert_allclose(simulated(browser, 0), error.T, rtol=0, atol=np.degrees(EQUAL))
    torque = 100 * other["controller.tau"]
    # a position off by 1e-9 rad is 2e-6 N.m off under K_p, and the rate of the loop, 1e2 /s, under K_v of 50 twice that
    np.testing.assert_allclose(simulated(browser, 2)[:6], torque.T, rtol=0, atol=1e-5)
    assert words_of(browser, ".canvas").split() == ["recorded", "simulated"]
    browser.run("report.view.change('time', 1)")
    cells = "[...document.querySelectorAll('.readout tr:nth-child(2) output')].map(e => e.textContent)"
    recorded, second = browser.run(cells)
    assert second == f"{torque[-1, 1]:.3g} N.m" != recorded
    after = browser.run(tiles)
    assert any(f"{was} →" in now for was, now in zip(before, after, strict=True))
    browser.run(f"(async () => {{ document.querySelector('#simulate button').click(); {DONE} }})()")
    browser.settle()
    assert 0 <= browser.run("report.simulation.apart") < EQUAL
    assert browser.run("report.player.scene.puppets.length") == 1
    assert browser.run(tiles) == before


def test_a_mass_of_one_link_and_what_the_feedforward_knows(run, browser):
    opened(browser, run / "report.html")
    slide(browser, "Masses", 100, joint=3)
    changes = browser.run("report.simulation.changes()")
    assert {change["unit"] for change in changes} == {"plant"} and {change["factor"] for change in changes} == {2}
    names = {change["name"] for change in changes}
    assert "mass[3]" in names and "inertia[3,1,1]" in names and not any("[2" in name for name in names)
    unknown = np.abs(simulated(browser, 0)).max()
    browser.run(f"(async () => {{ document.querySelector('.slider .chip').click(); {DONE} }})()")
    compensated = np.abs(simulated(browser, 0)).max()
    assert {change["unit"] for change in browser.run("report.simulation.changes()")} == {"plant", "feedforward"}
    assert compensated < 0.1 * unknown  # an arm that is known is followed as well as before


def test_a_run_that_fails_says_why_and_shows_how(run, browser):
    opened(browser, run / "report.html")
    slide(browser, "Proportional", 100)
    slide(browser, "Derivative", -100)
    said, message = words_of(browser, "#simulate [role=alert]"), words_of(browser, "#found .failure")
    assert said == "Stopped with proportional gains × 10; derivative gains × 0.1."
    assert message.startswith("plant: doStep at t = 0.") and "Check its inputs and the gains" in message
    begin = browser.run("report.view.marks[0].time")
    assert 0.0 < begin <= simulated(browser, 0).shape[1] * 1e-3
    # marked in each figure that is in sight
    assert browser.run("report.charts.filter(c => c.plot && c.seen).every(c => c.place.querySelector('.event'))")
    assert browser.run("document.querySelector('#found .checks ul').classList.contains('other')")
    reached = simulated(browser, 0)
    assert 100 < reached.shape[1] < 1000 and np.abs(reached).max() > 1.0  # degrees
    assert "Stopped at 0." in words_of(browser, "#simulate [role=status]")
    browser.run(f"(async () => {{ document.querySelector('#simulate button').click(); {DONE} }})()")
    assert browser.run("document.querySelector('#simulate [role=alert]').hidden")
    assert browser.run("report.view.marks.length + document.querySelectorAll('.event').length") == 0
    assert 0 <= browser.run("report.simulation.apart") < EQUAL


def test_verdict_tiles_and_figures_follow_the_sliders_in_one_screen(run, browser):
    opened(browser, run / "report.html", 1280, 900)
    browser.run("scrollTo(0, 0)")
    texts = (
        "['.verdict', ...[1, 2, 3, 4].map(k => `.tile:nth-child(${k})`)].map(e => document.querySelector(e).innerText)"
    )
    before = browser.run(texts)
    slide(browser, "Proportional", 100)
    slide(browser, "Derivative", -100)
    after, marks = browser.run(texts), browser.run("report.view.marks")
    assert browser.run("document.querySelector('.verdict').className") == "verdict failed"
    assert re.match(r"Simulated, failed: run ended at 0\.\d+ s", after[0])
    assert words_of(browser, ".checks summary").startswith("Recorded: ")
    for was, tile in zip(before[1:], after[1:], strict=True):
        assert was.split("\n")[1] + " →" in tile  # the recorded value, an arrow, the new one
    assert after[3].split("→")[1].strip().replace("\xa0", " ").startswith("not judged")
    low, high = browser.run("[report.charts[0].plot.scales.x.min, report.charts[0].plot.scales.x.max]")
    assert low < marks[0]["time"] < high and high - low < 1.0
    slide(browser, "Proportional", 0)
    slide(browser, "Derivative", 0)
    assert browser.run(texts) == before and browser.run("report.view.range") is None
    slide(browser, "Masses", 100)
    assert words_of(browser, ".verdict").startswith("Simulated, doubtful: stability not judged here")
    assert "this command judges it: vdfmu run tracking " in words_of(browser, "#found")
    assert browser.run("document.querySelector('.tile').className") == "tile worse"


def test_a_run_that_failed_has_sliders_and_goes_on_with_others(browser, tmp_path):
    with pytest.raises(CosimError):
        vdfmu.run("tracking", stop=0.5, out=tmp_path, parameters={"controller.K_v": 300.0}, reference=False,
                  simulate=True)  # fmt: skip
    opened(browser, tmp_path / "partial" / "report.html")
    assert words_of(browser, "#found li").startswith("good")
    end = browser.run("report.view.full()[1]")
    assert end < 0.4
    slide(browser, "Derivative", -100)
    said = words_of(browser, ".verdict")  # that of the failed run knows nothing of a margin
    assert said.startswith("Simulated, doubtful: stability not judged here") and "maximum tool error" in said
    assert browser.run("[report.view.full()[1], Number(report.player.slider.max)]") == [0.5, 0.5]


def test_a_track_shows_the_margin_before_the_limit_is_passed(run, browser):
    opened(browser, run / "report.html")
    gains = browser.run("report.runs[0].simulation.sliders[1]")
    low, high = gains["track"]["limits"]
    # with less damping the wrist's rotor swings where friction falls with speed; with more the samples are too late
    assert -100 < low < 0 < high < 100
    track = "document.querySelector('.slider:nth-child(2) .track')"
    places = browser.run(f"[...{track}.querySelectorAll('b')].map(e => parseFloat(e.style.left))")
    assert places == pytest.approx([50 + low / 2, 50 + high / 2], abs=1e-3)  # percent, as written
    # stable below the limit and unstable above it, in words too, and so it is in the run
    for place, word in ((high - 3, "margin"), (high + 3, "unstable")):
        slide(browser, "Derivative", round(place))
        said = words_of(browser, ".slider:nth-child(2) small")
        assert said.startswith(word) and re.search(r"; stable × 0\.\d+ to \d", said)
        assert word in browser.run("document.querySelectorAll('.slider input')[1].getAttribute('aria-valuetext')")
    assert "derivative gains × " in words_of(browser, "#simulate [role=alert]")
    slide(browser, "Derivative", 0)


def test_a_link_opens_the_sliders_as_they_were(run, browser):
    opened(browser, run / "report.html")
    slide(browser, "Proportional", 20, joint=2)
    slide(browser, "Masses", 100)
    browser.run("document.querySelectorAll('.slider .chip')[0].click()")
    browser.run(f"(async () => {{ {DONE} await new Promise(d => setTimeout(d, 400)); }})()")
    address, changes, curves = (
        browser.run("location.href"), browser.run("report.simulation.changes()"), simulated(browser, 0),
    )  # fmt: skip
    assert address.endswith("#controller.K_p=1_1_1.58&plant.mass=2_known")
    browser.open("about:blank")
    browser.open(address)
    browser.run(f"(async () => {{ await new Promise(d => setTimeout(d, 50)); {DONE} }})()")
    assert browser.run("report.simulation.changes()") == changes
    np.testing.assert_array_equal(simulated(browser, 0), curves)


def test_what_limits_a_run_is_found_by_running_again(run, browser):
    opened(browser, run / "report.html")
    browser.run("""(async () => {
        document.querySelector('.budget button').click();
        while (document.querySelector('.budget button').disabled) await new Promise((done) => setTimeout(done, 10));
    })()""")
    rows = browser.run(
        "[...document.querySelectorAll('.budget tbody tr')].map(r => [...r.children].map(c => c.innerText))"
    )
    assert [row[0] for row in rows] == [
        "As recorded", "Sampled 4 times as often", "No friction, and none expected",
        "Drives 4 times as stiff, and known to be",
    ]  # fmt: skip
    largest = [float(row[2].split()[0]) for row in rows]
    bars = browser.run("[...document.querySelectorAll('.budget .share i')].map(e => e.offsetWidth)")
    # in proportion to the numbers, which have three digits, to the pixel of each end
    share = np.array(largest) / max(largest)
    assert bars[0] > 50 and np.abs(bars - max(bars) * share).max() <= 1.0 + 5e-3 * max(bars)
    # the torque is held over a step: an error in proportion to it, and what else there is
    assert 0.2 < largest[1] / largest[0] < 0.35
    # a run with a quarter of the step, by the FMUs
    fine = vdfmu.run("tracking", stop=1.0, step=2.5e-4, out=False, parameters={"trajectory.T": 1.0}, reference=False)
    coarse = Results.read(run / "results.csv")
    ratio = [np.abs(each["trajectory.q_d"] - each["plant.q"]).max() for each in (fine, coarse)]
    assert largest[1] / largest[0] == pytest.approx(ratio[0] / ratio[1], rel=0.25)  # of the tool, not of a joint
    browser.run("document.querySelector('.budget button').click()")
    slide(browser, "Proportional", 5)
    assert words_of(browser, ".budget [role=status]") == "Stopped for a slider."


def test_a_slow_run_ends_for_a_newer_one(run, browser):
    opened(browser, run / "report.html")
    # the runs before were fast; this one takes seconds, of which the page waits one
    browser.run("report.runs[0].simulation.steps = 2e5; report.runs[0].simulation.stop = 200")
    browser.run(f"""(async () => {{
        report.first = report.simulation.worker.worker;
        const slider = document.querySelector(".slider input");
        const move = (place) => {{ slider.value = place; slider.dispatchEvent(new Event("input")); }};
        move(-30);
        await new Promise((done) => setTimeout(done, 30));
        report.runs[0].simulation.steps = 1000;
        report.runs[0].simulation.stop = 1;
        move(-60);
        {DONE}
    }})()""")
    assert browser.run("report.first !== report.simulation.worker.worker")  # it was ended
    assert simulated(browser, 0).shape == (6, 1001)
    assert browser.run("report.simulation.changes()[0].factor") == 0.251


def test_a_run_of_a_comparison_is_chosen(run, browser, tmp_path):
    pytest.importorskip("vdfmu.extras.compare")
    planar, package = tmp_path / "planar", tmp_path / "package"
    vdfmu.run("planar_tracking", stop=0.2, out=planar, reference=False)
    run_system(planar / "system.ssp", stop=0.2, out=package)
    runs = [read_run(folder) for folder in (run, planar, package)]
    opened(browser, write_report(runs, tmp_path / "three.html", simulate=True), 1280, 2600)
    assert words_of(browser, "#facts p.note").startswith("vdfmu_planar_tracking: This run is not simulated here: ")
    slide(browser, "Proportional", -60)
    assert browser.run("report.player.scene.puppets.length") == 2
    browser.run(f"""(async () => {{
        const select = document.querySelector("#simulate .bar select");
        select.value = 1;
        select.dispatchEvent(new Event("change"));
        {DONE}
    }})()""")
    assert 0 <= browser.run("report.simulation.apart") < EQUAL
    slide(browser, "Proportional", -60)
    assert simulated(browser, 0).shape == (2, 201)
    assert browser.run("report.player.scene.run.name") == "planar_tracking"  # the arm follows
    assert words_of(browser, ".canvas").split() == ["recorded", "simulated"]


def test_undo_takes_back_one_slider_after_the_other(run, browser):
    opened(browser, run / "report.html")
    places = "report.simulation.sliders.map(({ places }) => places[0]).slice(0, 2)"
    undo = "[...document.querySelectorAll('#simulate button')].find((b) => b.textContent === 'Undo')"
    assert browser.run(f"{undo}.disabled")
    browser.run("""for (const place of [3, 4, 5]) {  // as a drag does
        const { slider } = report.simulation.sliders[0];
        slider.value = place;
        slider.dispatchEvent(new Event("input"));
    }""")
    calm(browser)
    browser.run("new Promise((done) => setTimeout(done, 800))")  # another change of the same slider is not a part of it
    slide(browser, "Derivative", 7)
    for left in ([5, 7], [5, 0], [0, 0]):
        assert browser.run(places) == left
        browser.run(f"{undo}.click()")
        calm(browser)
    assert browser.run(f"{undo}.disabled") and browser.run(places) == [0, 0]
