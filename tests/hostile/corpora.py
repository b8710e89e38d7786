"""All corpora: each module of this folder that has some is named here; those of extras are found."""

from importlib import import_module

from tests.hostile.commands import extra_tests

_NAMES = (
    "packages", "bombs", "unpacked", "models", "results", "studies", "foreign", "signals", "surroundings", "faults",
    "disk", "calls",
)  # fmt: skip
_MODULES = (*(import_module(f"tests.hostile.{name}") for name in _NAMES), *extra_tests("hostile"))
CORPORA = [corpus for module in _MODULES for corpus in module.CORPORA]
