"""Puts the words of a comparison into docs/compare.md: ``python docs/comparison.py [results/compare]``."""

import sys
from pathlib import Path

BEGIN, END = "<!-- begin: written by python docs/comparison.py -->\n", "<!-- end -->\n"


def main(folder: str = "results/compare") -> None:
    """Replace what is between the marks."""
    page = Path(__file__).with_name("compare.md")
    words = Path(folder, "summary.md").read_text(encoding="utf-8").partition("\n\n")[2].replace("\n## ", "\n### ")
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    page.write_text(f"{before}{BEGIN}{words}{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
