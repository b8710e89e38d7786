"""The pages look as they did: twelve states, coarse and in grey, against the kept pictures.

After a change that is wanted, ``KEEP_PICTURES=1`` in the environment takes them anew: look at them first.
"""

import base64
import io
import json
import os
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image

import vdfmu
from tests.study.page.browser import FIND_OUT, PHONE, WIDE, Browser, calm, draw_all, show
from vdfmu.base.extras import extra_modules

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
KEPT = Path(__file__).parent / "pictures"
CELL = 20
"""Pixels of the page to a pixel of a picture, each way."""
TOLERANCE = 26
"""Two edges of full contrast that another browser puts a pixel elsewhere: 2 · 255 / 20. Times in texts change 7."""
FONTS = {
    weight: base64.b64encode((Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name).read_bytes()).decode()
    for weight, name in {"400": "DejaVuSans.ttf", "700": "DejaVuSans-Bold.ttf"}.items()
}
SAME_FONT = (
    f"const fonts = {json.dumps(FONTS)};"
    + """
for (const [weight, data] of Object.entries(fonts))
    document.fonts.add(new FontFace("kept", Uint8Array.from(atob(data), (c) => c.charCodeAt(0)), { weight }));
const { set, get } = Object.getOwnPropertyDescriptor(CanvasRenderingContext2D.prototype, "font");
Object.defineProperty(CanvasRenderingContext2D.prototype, "font", {
    get, set(value) { set.call(this, value.replace(/system-ui.*/, "kept")); }
});
const sheet = new CSSStyleSheet();
sheet.replaceSync("html, html * { font-family: kept !important }");
document.adoptedStyleSheets = [sheet];
"""
)
"""Pages take the font of the system. This one, which matplotlib brings, makes texts as wide on each machine."""
MOVE = "(s => { s.value = s.max; s.dispatchEvent(new Event('input')) })(document.querySelectorAll('.slider input')[1])"
ZOOM = "report.view.change('range', [0.2, 0.6]); report.view.show('hiddenJoints', 2, false)"
STATES = {
    "run": ("run", WIDE, "light", ""),
    "run_dark": ("run", WIDE, "dark", ""),
    "run_phone": ("run", PHONE, "light", ""),
    "run_print": ("run", (760, 1075), "print", ""),
    "run_limits": ("run", WIDE, "light", f"{FIND_OUT}.then(() => document.querySelector('.budget').scrollIntoView())"),
    "run_zoomed": ("run", WIDE, "light", f"{ZOOM}; document.querySelector('#figures').scrollIntoView()"),
    "run_unstable": ("run", WIDE, "light", MOVE),
    **({name: (name, WIDE, "light", "") for name in ("comparison", "list")} if extra_modules("gallery") else {}),
    "study": ("study", WIDE, "light", ""),
    "study_phone": ("study", PHONE, "dark", "document.querySelector('.panel button').click()"),
    **({"robot": ("robot", WIDE, "light", "")} if extra_modules("robot_page") else {}),
}
"""Page, size of the window, scheme of colours or medium, and what is done first."""


@pytest.fixture(scope="module")
def drawn(browser) -> Browser:
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=SAME_FONT)
    return browser


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Path:
    page = tmp_path_factory.mktemp("robot") / "robot.html"
    extra_modules("robot_page")[0].write_robot_page(vdfmu.load_robot("planar_2dof"), page)
    return page


def coarse(browser: Browser, width: int, height: int) -> np.ndarray:
    """Return the mean luminance of the cells of the window."""
    clip = {"x": browser.run("scrollX"), "y": browser.run("scrollY"), "width": width, "height": height, "scale": 1}
    data = browser.call("Page.captureScreenshot", format="png", clip=clip)["data"]
    picture = Image.open(io.BytesIO(base64.b64decode(data))).convert("L")
    return np.asarray(picture.reduce(CELL), dtype=int)


def shot(browser: Browser, page: Path, size: tuple[int, int], scheme: str, script: str) -> np.ndarray:
    show(browser, page, *size, scheme="light" if scheme == "print" else scheme)
    draw_all(browser)
    if scheme == "print":
        browser.call("Emulation.setEmulatedMedia", media="print")
    browser.run(script)
    calm(browser)
    try:
        return coarse(browser, *size)
    finally:
        browser.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("state", STATES)
def test_a_page_looks_as_it_did(pages, request, drawn, state):
    kind, *how = STATES[state]
    picture = shot(drawn, request.getfixturevalue("robot") if kind == "robot" else pages[kind], *how)
    path = KEPT / f"{state}.png"
    if "KEEP_PICTURES" in os.environ:
        KEPT.mkdir(exist_ok=True)
        Image.fromarray(picture.astype(np.uint8)).save(path, optimize=True)
    kept = np.asarray(Image.open(path), dtype=int)
    assert picture.shape == kept.shape
    places = [(CELL * int(x), CELL * int(y)) for y, x in np.argwhere(np.abs(picture - kept) > TOLERANCE)]
    assert places == [], f"{path.name}: the page looks otherwise around these pixels; see the top of this file"
