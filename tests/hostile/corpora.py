"""All corpora: each module of this folder that has some is named here."""

from . import bombs, calls, faults, models, packages, results, runs, signals

CORPORA = [
    corpus
    for module in (packages, bombs, models, results, signals, faults, calls, runs)
    for corpus in module.CORPORA
]
