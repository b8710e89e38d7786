"""All corpora: each module of this folder that has some is named here."""

from tests.hostile import bombs, calls, disk, faults, models, packages, results, runs, signals, studies, surroundings

CORPORA = [
    corpus
    for module in (packages, bombs, models, results, studies, signals, surroundings, faults, disk, calls, runs)
    for corpus in module.CORPORA
]
