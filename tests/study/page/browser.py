"""Chromium, headless, driven through its DevTools pipe, with keys, a mouse, its console and its requests."""

import base64
import io
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any, Self

import numpy as np
from PIL import Image

_FLAGS = (
    *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),  # root has none
    "--headless=new", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip
_PROGRAMS = (
    "chromium", "chromium-browser", "google-chrome", "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)  # fmt: skip


WIDE, PHONE = (1280, 900), (390, 844)
"""Sizes of a window [px]."""
FIND_OUT = """(async () => {
    const button = document.querySelector(".budget button");
    button.click();
    for (let k = 0; k < 1000 && button.disabled; k += 1)
        await new Promise((done) => setTimeout(done, 20));
})()"""
"""Script that asks for the error budget of a run, until it is there."""


class Browser:
    """A page in a browser of its own, with a folder for its profile."""

    def __init__(self, profile: Path) -> None:
        self.problems: list[str] = []
        """Errors, and messages of the console."""
        self.requests: list[str] = []
        """Addresses that the page asked for."""
        self.asked: list[str] = []
        program = next(filter(None, map(shutil.which, _PROGRAMS)), None)
        assert program is not None, "expected Chromium or Chrome, found none: 'apt-get install chromium'"
        import fcntl  # Windows has none

        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()
        # above 9, so that neither is in the way of the other
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (to_read, to_write)]

        def connect() -> None:  # the browser reads commands from its descriptor 3 and writes answers to 4
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [program, *_FLAGS, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=connect, pass_fds=(3, 4), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for end in (to_read, to_write, *ends):
            os.close(end)
        self._rest, self._number = b"", 0
        try:
            targets = self._call("Target.getTargets")["targetInfos"]
            page = next(target for target in targets if target["type"] == "page")["targetId"]
            self._session = self._call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.call(f"{domain}.enable")
            self.call("Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True, flatten=True)
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._to)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._from)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the page's DevTools; its answer."""
        return self._call(method, self._session, **parameters)

    def _call(self, method: str, session: str = "", **parameters: Any) -> dict[str, Any]:
        number = self.send(method, session, **parameters)
        while True:
            answer = self._message()
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"browser: {method}: {answer['error']}")
                return answer["result"]
            self.happened(answer)

    def send(self, method: str, session: str = "", **parameters: Any) -> int:
        """Call a method of a session without waiting for its answer; the number of the call."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        text = json.dumps(message | ({"sessionId": session} if session else {}))
        os.write(self._to, text.encode() + b"\0")
        return self._number

    def _message(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            block = os.read(self._from, 1 << 20)
            if not block:
                raise RuntimeError("the browser has ended")
            self._rest += block
        text, self._rest = self._rest.split(b"\0", 1)
        return json.loads(text)

    def happened(self, event: dict[str, Any]) -> None:
        """Note errors, what the console said, and requests."""
        kind, facts = event.get("method"), event.get("params", {})
        if kind == "Runtime.exceptionThrown":
            self.problems.append(str(facts["exceptionDetails"]))
        elif kind == "Runtime.consoleAPICalled" and facts["type"] in ("error", "warning", "assert"):
            self.problems.append(str(facts["args"]))
        elif kind == "Log.entryAdded" and facts["entry"]["level"] == "error":
            self.problems.append(str(facts["entry"]))
        elif kind == "Network.requestWillBeSent":
            self.requests.append(facts["request"]["url"][:200])
        elif kind == "Network.webSocketCreated":
            self.requests.append(facts["url"])
        elif kind == "Target.attachedToTarget":  # a worker, which may ask for something too
            for method in ("Network.enable", "Runtime.runIfWaitingForDebugger"):
                self.send(method, facts["sessionId"])

    def run(self, script: str) -> Any:
        """Value of an expression of JavaScript, which may be a promise."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"browser: {script}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until all changes are drawn."""
        self.run("new Promise(d => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(d, 30))))")

    def open(
        self,
        page: Path | str,
        width: int = 1280,
        height: int = 900,
        scheme: str = "light",
        motion: str = "",
        scale: float = 1.0,
    ) -> None:
        """Open a file or an address in a window of a size; `scale`: pixels of the screen to each of the page."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale,
            mobile=width < 600,
        )  # fmt: skip
        features = {"prefers-color-scheme": scheme, "prefers-reduced-motion": motion}
        media = [{"name": name, "value": value} for name, value in features.items()]
        self.call("Emulation.setEmulatedMedia", features=media)
        self.call("Page.navigate", url=page if isinstance(page, str) else page.resolve().as_uri())
        self.run("new Promise(d => document.readyState === 'complete' ? d() : addEventListener('load', () => d()))")
        self.run(  # a page of a run unpacks its libraries first
            "new Promise(d => { const look = n => n && document.getElementById('vendor') && !globalThis.report"
            " ? setTimeout(look, 20, n - 1) : d(); look(500); })"
        )
        self.settle()

    def picture(self, selector: str = "") -> bytes:
        """Picture of an element, or of all of the page, as PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        box = {"x": 0, "y": 0, "width": size["width"], "height": size["height"]}
        if selector:
            box = self.run(
                f"(r => ({{x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height}}))"
                f"(document.querySelector({selector!r}).getBoundingClientRect())"
            )
        answer = self.call("Page.captureScreenshot", format="png", clip=box | {"scale": 1}, captureBeyondViewport=True)
        return base64.b64decode(answer["data"])

    def window(self) -> bytes:
        """Picture of what the window shows, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def key(self, key: str, code: int) -> None:
        """Press a key."""
        text = {"text": {" ": " ", "Enter": "\r"}[key]} if key in (" ", "Enter") else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)
        self.settle()

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Move or press the mouse: ``mouseMoved``, ``mousePressed`` or ``mouseReleased``."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)
        self.settle()


def show(browser: Browser, path: Path, *size: int, **more: str) -> None:
    browser.asked.append(path.as_uri())
    browser.open(path, *size, **more)


def draw_all(browser: Browser) -> None:
    """Let each figure come into sight once, so that it is drawn."""
    browser.run("document.querySelectorAll('.plot').forEach((plot) => plot.scrollIntoView())")
    browser.settle()
    browser.run("scrollTo(0, 0)")
    calm(browser)


def calm(browser: Browser) -> None:
    """Wait until the page's own simulation has ended, and all is drawn."""
    browser.settle()
    browser.run("""(async () => {
        for (let k = 0; k < 500 && document.querySelector("progress.on"); k += 1)
            await new Promise((done) => setTimeout(done, 20));
    })()""")
    browser.settle()


def pixels(browser: Browser, selector: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(browser.picture(selector))).convert("L"), dtype=int)


def centre(browser: Browser, selector: str) -> tuple[float, float]:
    browser.run(f"document.querySelector({selector!r}).scrollIntoView({{block: 'center'}})")
    browser.settle()
    box = browser.run(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def number(text: str) -> float:
    return float(text.replace("−", "-"))
