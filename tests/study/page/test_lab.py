"""The page of a study in a browser: pictures that choose together, and points that it runs again."""

import json

import numpy as np
import pytest

import vdfmu
from tests.study.page.browser import centre, show
from vdfmu.study.sweeps.sweep import Sweep

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
PHONE = (390, 844)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    over = ["controller.K_p=*1, 2, 3", "plant.mass[2]=*0.8, 1.2", "algorithm=gauss-seidel, jacobi"]
    swept = vdfmu.sweep(
        "planar_tracking", over, stop=0.2, workers=1, record=("plant.q[*]",),
        measure=["error=max(abs(trajectory.q_d - plant.q))"], out=tmp_path_factory.mktemp("study") / "study",
    )  # fmt: skip
    swept.report()
    return swept


def test_a_chosen_point_is_run_with_its_parameters(study, browser):
    show(browser, study.folder / "report.html")
    able = browser.run("report.lab.all.filter(row => report.lab.changes(row))")
    algorithm = study.row("best")["algorithm"]
    assert able == [k for k, master_of_row in enumerate(study["algorithm"]) if master_of_row == algorithm]
    for row in (able[0], able[-1]):
        errors = browser.run(f"""(async () => {{
            const worker = new report.SimulationWorker(report.binaries);
            const {{ signals }} = await worker.run(report.runs[0].simulation, report.lab.changes({row}));
            const error = (k) => Math.max(...signals.get(`plant.q[${{k}}]`).map(
                (v, i) => Math.abs(signals.get(`trajectory.q_d[${{k}}]`)[i] - v)));
            return [error(1), error(2)];
        }})()""")
        # the batch engine and WebAssembly have a sin and a cos of their own, 1e-15 of positions of 2 rad, and a solver
        # with tolerance 1e-7, which steps alike
        np.testing.assert_allclose(errors, [study["error[1]"][row], study["error[2]"][row]], rtol=1e-6, atol=1e-12)
    browser.run(f"report.lab.choose({able[-1]})")
    browser.run("new Promise(d => report.view.addEventListener('simulated', () => d(), { once: true }))")
    assert browser.run("report.runs.at(-1).result.time.length") == 201
    other = next(k for k in range(len(study)) if k not in able)
    browser.run(f"report.lab.choose({other})")
    assert f"--row {study['point'][other]}" in browser.run("document.querySelector('.panel code').textContent")
    assert "more than parameters" in browser.run("document.querySelector('.panel').textContent")


def test_dragging_along_an_axis_chooses_points_in_all_pictures(study, browser):
    show(browser, study.folder / "report.html")
    shown = "[...document.querySelectorAll('#lab .study')].map(s => s.querySelectorAll('.point.off, .way.off').length)"
    assert browser.run(shown) == [0, 0, 0]
    k = browser.run("report.lab.axes.findIndex(c => c.name.startsWith('controller.K_p'))")
    centre(browser, "#lab > figure .axis")
    box = browser.run(f"document.querySelectorAll('#lab > figure .axis')[{k}].getBoundingClientRect().toJSON()")
    x, top = box["x"] + 1, box["y"]
    browser.mouse("mousePressed", x, top - 5, button="left", clickCount=1)
    browser.mouse("mouseMoved", x, top + 0.25 * box["height"], button="left")
    browser.mouse("mouseReleased", x, top + 0.25 * box["height"], button="left", clickCount=1)
    # of three gains the largest alone: 4 of 12 points
    assert browser.run(shown) == [8, 8, 8]
    assert browser.run("document.querySelector('#lab [role=status]').textContent") == "4 of 12 points"
    browser.run("[...document.querySelectorAll('#lab button')].find(b => b.textContent === 'Show all').click()")
    assert browser.run(shown) == [0, 0, 0]


def test_a_click_on_a_point_opens_it_and_without_a_simulation_the_page_has_all_else(study, browser, tmp_path):
    show(browser, study.folder / "report.html")
    row = browser.run("report.lab.all.findIndex(row => report.lab.colour.share(row) === 1)")
    centre(browser, "#lab .study")
    mark = f"document.querySelectorAll('#lab .study')[0].querySelectorAll('.point')[{row}]"
    box = browser.run(f"{mark}.getBoundingClientRect().toJSON()")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    browser.mouse("mouseReleased", x, y, button="left", clickCount=1)
    assert browser.run("document.querySelector('.panel h2').textContent") == f"Point {study['point'][row]}"
    path = Sweep(study.path).report(tmp_path / "report.html", simulate=False)
    assert path.stat().st_size < 200_000
    show(browser, path, *PHONE)
    assert browser.run("document.documentElement.scrollWidth") <= PHONE[0]
    assert json.loads(browser.run("JSON.stringify(report.lab.study.points)")) == study["point"].tolist()


def test_triangles_fill_the_plane_between_points_and_scales_have_several_ticks(study, browser):
    show(browser, study.folder / "report.html")
    areas = browser.run("""(() => {
        const [mass, gain] = report.lab.axes.filter(c => !c.words.length);
        const { places, triangles } = report.lab.field(mass, gain);
        return triangles.map(t => t.map(k => places[k])).map(([a, b, c]) =>
            ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2);
    })()""")
    # a grid of 3 x 2 over the unit square: two squares of two triangles, each moved by 1e-7 at most
    np.testing.assert_allclose(areas, [0.25] * 4, atol=1e-6)
    ticks = """(() => { const Column = report.lab.columns[0].constructor;
        const facts = { name: "a", unit: "", words: [], axis: true };
        return [[1900, 2100], [300, 9000], [1e-7, 1e2]].map(values =>
            new Column({ ...facts, log: true, values }).ticks(5)); })()"""
    narrow, decade, wide = browser.run(ticks)
    assert narrow == [1900, 1950, 2000, 2050, 2100] and decade == [500, 1000, 2000, 5000]
    np.testing.assert_allclose(wide, [1e-7, 1e-5, 1e-3, 1e-1, 1e1], rtol=1e-12)
