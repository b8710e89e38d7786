"""Warn of words that are not those of the field: ``python docs/words.py``. A warning fails nothing."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FIELD = {
    r"error by communication": "coupling error",
    r"excites too little|tells little of": "does not excite",
    r"over the ratios?\b": "divided by the gear ratio",
    r"gains are chosen": "the gains are ours",
    r"with the bits of": "bit-identical to",
    r"comes? nearer": "zoom",
    r"\bplays the reference": "replays",
    r"bears? (?:about )?half": "tolerates half the gain",
    r"\bwitness(?:es)?\b": "independent check",
    r"\breferees?\b": "judge",
    r"\bknobs?\b": "slider",
    r"\bas meant\b": "sampled or continuous",
    r"\bstands? (?:in|for)\b": "is in, means",
    r"\bways? out\b": "fix",
    r"number that is none\b": "NaN",
    r"\bwish(?:es)? (?:for|of)\b": "setting",
    r"what is left of|\bleaves of\b": "residual",
    r"(?:file|files) that (?:no run|others) (?:wrote|made)": "not written by vdfmu",
}
"""What is not said, and what is."""
_KINDS = (".md", ".py", ".toml", ".js", ".css", ".ipynb")


def main() -> None:
    """Print each place of such a word in the tracked texts."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    words = {re.compile(pattern, re.IGNORECASE): better for pattern, better in FIELD.items()}
    for name in listed.splitlines():
        if not name.endswith(_KINDS) or name == "docs/words.py" or "/bundles/" in name:
            continue
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1):
            for word, better in words.items():
                if match := word.search(line):
                    print(f"{name}:{number}: warning: {match[0]!r}; the field says: {better}")


if __name__ == "__main__":
    main()
