"""``python -m tests.hostile [--tries N] [NAME ...]``: try the corpora whose names hold a word, and print the table.

Ctrl-C ends it with the table so far.
"""

from __future__ import annotations

import argparse
import sys

from .corpora import CORPORA
from .table import Row, table, tried


def main() -> int:
    """Return how many tries failed, at most 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("names", nargs="*", help="words of the names of corpora; default all")
    parser.add_argument("--tries", type=int, help="tries of each corpus; default its own number")
    options = parser.parse_args()
    rows: list[Row] = []
    stopped = False
    for corpus in CORPORA:
        if not options.names or any(word in corpus.name for word in options.names):
            rows.append(Row(corpus.name))
            try:
                tried(corpus, range(options.tries or corpus.tries), rows[-1])
            except KeyboardInterrupt:  # the table so far
                stopped = True
            for example in rows[-1].examples:
                print(example, file=sys.stderr, flush=True)
            if stopped:
                break
    print(table(rows))
    return int(stopped or any(row.failures for row in rows))


if __name__ == "__main__":
    sys.exit(main())
