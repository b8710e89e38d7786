"""``python -m tests.hostile [--tries N] [NAME ...]``: try the corpora whose names hold a word, and print the table."""

from __future__ import annotations

import argparse
import sys

from .corpora import CORPORA
from .table import table, tried


def main() -> int:
    """Return how many tries failed, at most 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("names", nargs="*", help="words of the names of corpora; default all")
    parser.add_argument("--tries", type=int, help="tries of each corpus; default its own number")
    options = parser.parse_args()
    rows = []
    for corpus in CORPORA:
        if not options.names or any(word in corpus.name for word in options.names):
            rows.append(tried(corpus, range(options.tries or corpus.tries)))
            for example in rows[-1].examples:
                print(example, file=sys.stderr, flush=True)
    print(table(rows))
    return int(any(row.failures for row in rows))


if __name__ == "__main__":
    sys.exit(main())
