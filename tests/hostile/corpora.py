"""All corpora: each module of this folder that has some is named here."""

from . import bombs, models, packages, runs

CORPORA = [
    corpus
    for module in (packages, bombs, models, runs)
    for corpus in module.CORPORA
]
