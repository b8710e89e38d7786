"""The browser of :mod:`vdfmu.report.browser`, with keys, a mouse, and what it said and asked a network for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vdfmu.report import browser


class Browser(browser.Browser):
    """A page in a browser of its own; what its console said and what it asked any network for."""

    def __init__(self, profile: Path) -> None:
        self.problems: list[str] = []
        self.requests: list[str] = []
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
