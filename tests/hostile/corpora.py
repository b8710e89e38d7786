"""All corpora: each module of this folder that has some is named here."""

from importlib import import_module

_NAMES = (
    "packages", "bombs", "unpacked", "models", "results", "studies", "foreign", "signals", "surroundings", "faults",
    "disk", "calls", "runs",
)  # fmt: skip
CORPORA = [corpus for name in _NAMES for corpus in import_module(f"tests.hostile.{name}").CORPORA]
