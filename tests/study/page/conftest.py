"""Pages to show, and that a browser stayed quiet."""

from pathlib import Path

import pytest

import vdfmu
from vdfmu.base.extras import extra_modules
from vdfmu.study.report.page import animate, write_report
from vdfmu.study.report.shown_run import read_run


@pytest.fixture
def quiet(browser):
    """Hold of every test that the console had no error and the page asked for nothing but itself."""
    browser.problems.clear()
    browser.requests.clear()
    browser.asked.clear()
    yield
    assert browser.problems == []
    assert {url for url in browser.requests if not url.startswith(("data:", "about:", "blob:"))} <= {*browser.asked}


@pytest.fixture(scope="session")
def pages(tmp_path_factory) -> dict[str, Path]:
    """Return a page of each kind: of a run, of an arm alone and of a study; with an extra of two, and a list."""
    folder = tmp_path_factory.mktemp("pages")
    vdfmu.run("tracking", stop=1.0, out=folder / "tracking", parameters={"trajectory.T": 1.0})
    run = read_run(folder / "tracking")
    over = ["controller.K_p=*1, 2, 3", "plant.mass[2]=*0.8, 1.2", "algorithm=gauss-seidel, jacobi"]
    study = vdfmu.sweep(
        "planar_tracking", over, stop=0.2, workers=1, measure=["error=max(abs(trajectory.q_d - plant.q))"],
        out=tmp_path_factory.mktemp("study") / "study",
    )  # fmt: skip
    made = {
        "run": write_report([run], folder / "run.html", simulate=True),
        "arm": animate(folder / "tracking").save(folder / "arm.html"),
        "study": study.report(),
    }
    for extra in extra_modules("gallery"):
        made["list"] = extra.write_gallery(folder, folder / "index.html")
        made["comparison"] = write_report([run, run._replace(name="other")], folder / "comparison.html")
    return made
