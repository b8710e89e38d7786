"""The verdict on a simulated run of the page is that of ``vdfmu.run`` with the values of its sliders.

Fifty places of sliders over six scenarios, with every limit that a page can judge by.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

import vdfmu
from tests.study.page.browser import Browser, centre, show
from vdfmu.base.errors import CosimError
from vdfmu.engine.results.verdict import FAILED, GOOD, UNJUDGED

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
NOT_HERE = "not judged here"
OTHERS = {"reference"}
"""Checks against other calculations, which a page does not make."""
NUMBERS = {"margin": 0.005, "delay": 0.15}
"""Largest differences of the margins of loops. A track has the states of the recorded run, at some of its rows: modulus
margins differ by up to 0.005, as promised. A delay margin jumps where another resonance decides: seen 0.10 samples."""
GROWTH = 0.7
"""Relative difference of the exponents of a growth. It is an integral over the time in which a mode grows, which begins
and ends where the states of a run with these gains let it: seen 0.63, a factor of 23 beside 6. Whether it is unstable
has no number of its own."""
ROUNDING = 5e-4
"""Relative: half a unit of the third digit of numbers of the run itself, whose rows the page has to the last digits."""

Scenario = tuple[str, dict[str, Any], dict[str, Any]]
SCENARIOS: Mapping[str, Scenario] = {
    "planar": ("planar_tracking", {}, {}),
    "six": ("tracking", {"trajectory.T": 1.0}, {"stop": 1.0}),
    "wall": ("wall", {}, {}),
    "fast": ("reach", {"plant.kappa_dot_max[1]": 2.0}, {"robot": "scara_4dof"}),
    "weak": ("planar_tracking", {"controller.tau_max": 0.12}, {"limits": {"saturated": 0.3, "margin": 0.6}}),
    "slider": ("slider_tracking", {}, {"stop": 0.5}),
}
"""Name and settings of a run, and its options."""
K_P, K_V, MASS, T = "controller.K_p", "controller.K_v", "plant.mass", "trajectory.T"
PLACES: Mapping[str, Sequence[Mapping[str, float]]] = {
    "planar": [
        {K_P: 5, K_V: 0.1}, {K_P: 5.5, K_V: 0.15}, {K_P: 3, K_V: 0.1}, {K_P: 0.1}, {K_P: 0.5}, {K_P: 2}, {K_P: 3},
        {K_P: 8}, {K_V: 0.7}, {K_V: 0.5}, {K_V: 2}, {K_V: 4}, {K_V: 10}, {MASS: 2}, {T: 2}, {T: 0.5}, {T: 0.5, MASS: 2},
    ],
    "six": [{K_V: 1.3}, {K_V: 1.5}, {K_P: 6}, {K_P: 0.2}, {MASS: 2}, {T: 0.5}, {K_V: 6}],
    "wall": [{K_P: 10}, {K_P: 0.3}, {K_V: 1.5}, {K_V: 3}, {MASS: 0.5}, {K_P: 0.1, K_V: 0.5}, {T: 0.6}],
    "fast": [{T: 0.5}, {K_P: 0.5}, {K_P: 2}, {K_V: 0.8}, {K_V: 3}, {T: 0.7, K_P: 0.3}, {MASS: 2}],
    "weak": [{T: 0.5}, {K_P: 0.5}, {K_P: 5}, {MASS: 0.6}, {T: 0.7}, {T: 0.8}],
    "slider": [{K_P: 10}, {K_V: 0.2}, {K_V: 3}, {K_V: 8}, {MASS: 2}, {T: 2}],
}  # fmt: skip
"""Factors of sliders, by their keys."""
CASES = [(name, places) for name, each in PLACES.items() for places in each]


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> Any:
    """Return the page of a scenario, made once."""
    made: dict[str, Path] = {}

    def page(name: str) -> Path:
        if name not in made:
            scenario, settings, options = SCENARIOS[name]
            folder = made[name] = tmp_path_factory.mktemp(name)
            vdfmu.run(scenario, out=folder, parameters=settings, reference=False, simulate=True, **options)
        return made[name] / "report.html"

    return page


def of_page(browser: Browser, places: Mapping[str, float]) -> dict[str, Any]:
    """Return verdict and values of the page that is open, with its sliders at places."""
    return browser.run(f"""(async () => {{
        const {{ simulation }} = report, places = {json.dumps(dict(places))};
        for (const slider of simulation.sliders) slider.state = String(places[slider.parameter.key] ?? 1);
        simulation.rerun();
        while (simulation.busy) await new Promise((done) => setTimeout(done, 10));
        const {{ state, headline, checks }} = simulation.verdict;
        const command = report.commandOf(simulation.of, simulation.changes());
        return {{ state, headline, checks, figures: simulation.figures, command }};
    }})()""")


def of_run(name: str, command: str) -> Mapping[str, Any]:
    """Return the summary of the run of a scenario with the settings of a page's command."""
    scenario, settings, options = SCENARIOS[name]
    words = (word.strip("' ").partition("=") for word in command.split(" --set ")[1:])
    values = settings | {key: float(value) for key, _, value in words}
    try:
        return vdfmu.run(scenario, out=False, parameters=values, reference=False, **options).summary
    except CosimError as error:
        return {"verdict": {"state": FAILED, "checks": [], "headline": str(error)}, "error": str(error)}


def agree(browser: Browser, page: Path, name: str, places: Mapping[str, float]) -> None:
    """Compare a page with a run."""
    if browser.asked[-1:] != [page.as_uri()]:
        show(browser, page)
        centre(browser, "#simulate")
    simulated = of_page(browser, places)
    verdict = of_run(name, simulated["command"])["verdict"]
    ours, theirs = ({check["key"]: check for check in each["checks"]} for each in (simulated, verdict))
    if verdict["state"] == FAILED:
        assert simulated["state"] != GOOD
    if FAILED in (verdict["state"], simulated["state"]) and not ours.keys() & theirs.keys():
        assert verdict["state"] == simulated["state"]  # a run that stopped
        return
    shared = {key for key in ours.keys() & theirs.keys() if UNJUDGED not in (ours[key]["state"], theirs[key]["state"])}
    if NOT_HERE in (ours.get("stability") or {}).get("sentence", ""):
        assert simulated["state"] != GOOD
        shared -= {"stability"}
    else:
        assert {*ours} - OTHERS == {*theirs} - OTHERS and simulated["state"] == verdict["state"]
    for key in shared:
        assert ours[key]["state"] == theirs[key]["state"], key
        value, expected = ours[key].get("value"), theirs[key].get("value")
        if key in NUMBERS:
            assert value == pytest.approx(expected, abs=NUMBERS[key], rel=NUMBERS[key]), key
        elif key == "growth":
            assert math.log1p(value) == pytest.approx(math.log1p(expected), rel=GROWTH, abs=0.02)
        elif expected is not None:
            assert value == pytest.approx(expected, rel=ROUNDING, abs=1e-12), key
            assert ours[key]["sentence"] == theirs[key]["sentence"]


@pytest.mark.parametrize(("name", "places"), CASES)
def test_the_page_judges_as_a_run_with_the_values_of_its_sliders(pages, browser, name, places):
    agree(browser, pages(name), name, places)
