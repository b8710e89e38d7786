"""Messages of the units of one run."""

from __future__ import annotations

import logging
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from vdfmu.base.text import shown

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_LENGTH = 10_000
"""Bytes of a message that are kept."""
_FAILURE = re.compile("error|fatal|discard", re.IGNORECASE)
"""Part of the category of a message that is worse than its status."""
_LEVEL = {"ok": logging.DEBUG, "note": logging.INFO, "warning": logging.WARNING}


@dataclass(frozen=True)
class LogMessage:
    """A message of a unit, or (status ``note``) of the check before the run."""

    unit: str
    """Component name; empty for notes."""
    time: float
    """Communication point at which it came [s]."""
    status: str
    """``ok``, ``warning``, ``discard``, ``error``, ``fatal``, ``pending`` or ``note``."""
    category: str
    text: str

    def __str__(self) -> str:
        named = not self.unit or self.text.startswith(f"{self.unit}: ")  # some units name themselves
        return self.text if named else f"{self.unit}: {self.text}"


def log_to_logging(message: LogMessage) -> None:
    """Hand a message to the logger ``vdfmu.engine.run``."""
    logger = logging.getLogger("vdfmu.engine.run")
    logger.log(_LEVEL.get(message.status, logging.ERROR), "%s", message)


class MessageBox:
    """Collects the messages of the units of one run.

    `pending` holds what came since the last `flush`; the master flushes after each step, so that it holds
    what a failing unit said of it. `ended` holds the units that have ended the simulation, with the time of the end.
    """

    def __init__(self, log: Callable[[LogMessage], None] | None, limit: int = 10_000) -> None:
        self.pending: list[LogMessage] = []
        self.kept: deque[LogMessage] = deque(maxlen=limit)
        self.ended: dict[str, float] = {}
        self.time = 0.0
        self._log = log or log_to_logging
        self._limit = limit

    def add(self, message: LogMessage) -> None:
        """Take a message; of a flood between two flushes the last are kept."""
        self.pending.append(message)
        if len(self.pending) >= 2 * self._limit:
            del self.pending[: self._limit]

    def flush(self) -> None:
        """Show and keep what is pending."""
        messages = self.pending[:]
        self.pending.clear()
        for message in messages:
            self.kept.append(message)
            self._log(message)

    def reason(self, unit: str) -> str:
        """Return the reason that a unit gave since the last flush: its errors, else warnings, else its last message."""
        own = [m for m in self.pending if m.unit == unit]
        failed = [m for m in own if m.status not in ("ok", "warning") or _FAILURE.search(m.category)]
        worst = failed or [m for m in own if m.status == "warning"]
        text = " ".join(" ".join(m.text.split()) for m in worst)
        if not worst:
            return "the unit gave no reason" + (f"; its last message: {own[-1].text.strip()}" if own else "")
        text = re.sub(r"Fatal py exception encountered: \[\w+\] \w+ ?", "", text)  # pythonfmu's own prefix
        # a unit that names itself and the call: the error that quotes it names them already
        text = re.sub(rf"^{re.escape(unit)}: \w+( at t = \S+ s)? failed: ", "", text)
        return text or "the unit gave no reason"


boxes: dict[int, tuple[str, MessageBox]] = {}
"""Unit name and message box by the environment of the callbacks."""


def on_message(token: int | None, status: int, category: bytes, text: bytes) -> None:
    """Receive a message of any unit of the process."""
    message = shown(text[:_LENGTH].decode("utf-8", "replace")) if text else ""
    if text and len(text) > _LENGTH:
        message += f" ... ({len(text) - _LENGTH} bytes more)"
    label = STATUS[status] if 0 <= status < len(STATUS) else str(status)
    entry = boxes.get(token or 0)
    if entry is None:  # of fmpy's own instance, whose proxy knows only one receiver, now this one
        print(f"[{label.upper()}] {message}")
        return
    name, box = entry
    kind = shown(category[:_LENGTH].decode("utf-8", "replace")) if category else ""
    box.add(LogMessage(name, box.time, label, kind, message))
