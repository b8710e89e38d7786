"""All corpora: each module of this folder that has some is named here."""

from tests.hostile import (
    bombs,
    calls,
    disk,
    faults,
    foreign,
    models,
    packages,
    results,
    runs,
    signals,
    studies,
    surroundings,
    unpacked,
)

CORPORA = [
    corpus
    for module in (
        packages,
        bombs,
        unpacked,
        models,
        results,
        studies,
        foreign,
        signals,
        surroundings,
        faults,
        disk,
        calls,
        runs,
    )  # fmt: skip
    for corpus in module.CORPORA
]
