"""The browser of :mod:`vdfmu.study.report.browser`, with keys, a mouse, and what it said and asked a network for."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vdfmu.study.report import browser


class Browser(browser.Browser):
    """A page in a browser of its own; what its console said and what it asked any network for."""

    def __init__(self, profile: Path) -> None:
        self.problems: list[str] = []
        self.requests: list[str] = []
        self.asked: list[str] = []
        super().__init__(profile)
        for domain in ("Network", "Log"):
            self.call(f"{domain}.enable")
        self.call("Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True, flatten=True)

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

    def key(self, key: str, code: int) -> None:
        """Press a key."""
        text = {"text": key} if key == " " else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)
        self.settle()

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Move or press the mouse: ``mouseMoved``, ``mousePressed`` or ``mouseReleased``."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)
        self.settle()


def show(browser: Browser, path: Path, *size: int, **more: str) -> None:
    browser.asked = [path.as_uri()]
    browser.open(path, *size, **more)


def pixels(browser: Browser, selector: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(browser.picture(selector))).convert("L"), dtype=int)


def centre(browser: Browser, selector: str) -> tuple[float, float]:
    browser.run(f"document.querySelector({selector!r}).scrollIntoView({{block: 'center'}})")
    browser.settle()
    box = browser.run(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def number(text: str) -> float:
    """Return the number that a page writes as 1.5 or 1.5·10⁻³."""
    mantissa, _, power = text.replace("−", "-").partition("·10")
    return float(mantissa) * 10.0 ** int((power or "⁰").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
