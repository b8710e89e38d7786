"""``python -m tests.hostile [--tries N] [--write PAGE] [NAME ...]``: try the corpora whose names hold a word.

The table of what came of them is printed.

Ctrl-C ends it with the table so far.
"""

import argparse
import sys
from pathlib import Path

from tests.hostile.corpora import CORPORA
from tests.hostile.table import Row, replaced, table, tried


def main() -> int:
    """Return how many tries failed, at most 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("names", nargs="*", help="words of the names of corpora; default all")
    parser.add_argument("--tries", type=int, help="tries of each corpus; default its own number")
    parser.add_argument("--write", type=Path, help="page whose table gets the rows; rows of others stay")
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
    if options.write and not stopped:
        options.write.write_text(replaced(options.write.read_text(encoding="utf-8"), rows), encoding="utf-8")
    return int(stopped or any(row.failures for row in rows))


if __name__ == "__main__":
    sys.exit(main())
