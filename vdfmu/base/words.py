"""Words of commands and functions that have another name now."""

from __future__ import annotations

RENAMED: dict[str, dict[str, str]] = {
    "": {"models": "robot, scenario or schema"},
    "simulate": {"time_limit": "wait_limit", "plot": "pictures"},
    "federate": {"time_limit": "wait_limit"},
    "Simulator": {"time_limit": "wait_limit"},
    "sweep": {"over": "vary", "keep": "record", "n": "points"},
    "sweep plot": {"measure": "by"},
    "sweep indices": {"measure": "by"},
    "tune": {"over": "combine", "spread_n": "spread_points", "budget": "evaluations"},
    "compare": {"budget": "evaluations"},
    "margins": {"open": "loop"},
    "modes": {"path": "scenario"},
    "identify": {"start": "pose"},
    "ssp": {"format": "ssp"},
}
"""For each command, which has the name of its function, its old words and the new ones; of no command: commands."""


def new_word(command: str, word: str) -> str:
    """Return what an old word is called now, in the form of the old, ``--time-limit`` or ``time_limit``; else empty."""
    new = RENAMED.get(command, {}).get(word.lstrip("-").replace("-", "_"), "")
    return f"--{new.replace('_', '-')}" if new and word.startswith("-") else new
