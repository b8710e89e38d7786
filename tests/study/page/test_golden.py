"""The verdict on a simulated run of the page is that of ``vdfmu.run`` with the values of its sliders.

Fifty places of sliders over six scenarios, with every limit that a page can judge by.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import vdfmu
from tests.study.page.browser import Browser
from vdfmu.base.errors import CosimError
from vdfmu.engine.results.verdict import FAILED, STATES, UNJUDGED
from vdfmu.study.report.tracks import NOTCHES

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
HERE = {"stability", "friction", "feedback"}
"""Checks of loops: a page has them along one slider of gains, and says otherwise that it does not judge them."""
NUMBERS = {"margin": 0.005, "delay": 0.05, "growth": 0.05}
"""Largest differences of the numbers of loops. A track has the states of the recorded run, at some of its rows: margins
differ by up to 0.005, as promised, delays by 0.05 samples, growth by 5 %, half of its limit."""
ROUNDING = 5e-3
"""Relative: half a unit of the third digit."""

Places = Mapping[str, Mapping[int, float]]
"""Slider, to joint or 0 for all, to its factor."""
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


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> Any:
    """Return the page of a scenario, made once."""
    made: dict[str, Path] = {}

    def page(name: str) -> Path:
        if name not in made:
            scenario, settings, options = SCENARIOS[name]
            folder = made[name] = tmp_path_factory.mktemp(name)
            vdfmu.run(scenario, out=folder, settings=settings, reference=False, simulate=True, **options)
        return made[name] / "report.html"

    return page


def of_page(browser: Browser, places: Places) -> dict[str, Any]:
    """Return verdict and values of the page that is open, with its sliders at places."""
    return browser.run(f"""(async () => {{
        const {{ simulation }} = report, places = {json.dumps({key: dict(by) for key, by in places.items()})};
        for (const slider of simulation.sliders) {{
            const factors = places[slider.knob.key] ?? {{}};
            slider.state = Array.from({{ length: slider.places.length }}, (_, k) => factors[k] ?? 1).join("_");
        }}
        simulation.rerun();
        while (simulation.busy) await new Promise((done) => setTimeout(done, 10));
        const {{ state, headline, checks }} = simulation.verdict;
        const command = report.commandOf(simulation.of, simulation.changes());
        return {{ state, headline, checks, figures: simulation.figures, command }};
    }})()""")


def of_run(name: str, command: str) -> Mapping[str, Any]:
    """Return the summary of the run of a scenario with the settings of a page's command."""
    scenario, settings, options = SCENARIOS[name]
    words = [word.strip("'").partition("=") for word in command.split(" --set ")[1:]]
    values = settings | {key: float(value) for key, _, value in words}
    try:
        return vdfmu.run(scenario, out=False, settings=values, reference=False, **options).summary
    except CosimError as error:
        return {"verdict": {"state": FAILED, "checks": [], "headline": str(error)}, "error": str(error)}
