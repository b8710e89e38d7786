"""Print the figures of the documentation beside what their commands give: ``python -m tests.docs.claims [WORD ...]``.

`docs/claims.toml` has each figure, the text around it, and its command. The pages get their figures from there.
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import vdfmu
from tests.docs import quantities

ROOT = Path(__file__).resolve().parents[2]
WORDS = {word: 7 + i for i, word in enumerate(("seven", "eight", "nine", "ten", "eleven", "twelve"))}
_RAISED = "0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"
_POWER = f"10[{_RAISED[1]}]+"
NUMBER = rf"{_POWER}|[-−]?\d+(?:,\d{{3}})*(?:\.\d+)?(?:·{_POWER}|e[-+]?\d+)?|\b(?i:{'|'.join(WORDS)})\b"
"""A number as the pages write it: 0.5, 2,000, 4.6·10⁻¹⁰, 10⁻⁹, 4.56e-10, eleven."""


@dataclass(frozen=True)
class Claim:
    """Figures of a page, and what gives them. `docs/claims.toml` says what the fields are."""

    page: str
    text: str
    unit: str
    command: str = ""
    after: str = ""
    find: str = ""
    python: str = ""
    seen: str = ""
    tolerance: str = "rounded"
    why: str = ""

    @property
    def parts(self) -> list[str]:
        """The text between the figures and the figures, in turns."""
        braced = rf"\{{({NUMBER})\}}"
        return re.split(braced if re.search(braced, self.text) else f"({NUMBER})", self.text)

    def with_figures(self, figures: list[str]) -> str:
        """Return the text as `docs/claims.toml` has it, with other figures."""
        parts, form = self.parts, "{{{}}}" if re.search(rf"\{{({NUMBER})\}}", self.text) else "{}"
        parts[1::2] = map(form.format, figures)
        return "".join(parts)

    @property
    def pattern(self) -> str:
        """A regular expression of the text, with a group for each figure. Lines may break anywhere."""
        parts = [re.sub(r"(?:\\?\s)+", r"\\s+", re.escape(part)) for part in self.parts]
        return "".join(f"({NUMBER})" if i % 2 else part for i, part in enumerate(parts))

    def place(self, text: str) -> re.Match[str]:
        """Return the place of the text on its page; ValueError unless there is one."""
        places = list(re.finditer(self.pattern, text))
        if len(places) != 1:
            raise ValueError(f"{self.page}: expected one place with this text, got {len(places)}: {self.text}")
        return places[0]

    def found(self) -> list[float]:
        """Return the numbers that the command or the expression gives."""
        if self.command:
            output = _output(self.command)
            given = _groups(self.find or self.pattern, output[output.index(self.after) :])
        else:
            names = {"np": np, "vdfmu": vdfmu, "said": said, "numbers": numbers}
            given = np.ravel(eval(self.python, names | vars(quantities))).tolist()
        found = [value(each) if isinstance(each, str) else float(each) for each in given]
        figures = len(self.parts) // 2
        if found and self.tolerance.startswith("at "):
            found = [max(found) if self.tolerance == "at most" else min(found)] * figures
        if len(found) != figures:
            raise ValueError(f"expected {figures} numbers, got {found}")
        return found

    def agrees(self, figure: str, number: float) -> bool:
        """Whether a number is within the tolerance of a figure."""
        claimed, (kind, _, size) = value(figure), self.tolerance.partition(" ")
        if kind == "at":
            return number <= claimed if size == "most" else number >= claimed
        if kind == "x":
            return claimed / float(size) <= number <= claimed * float(size)
        share = 0.0 if kind == "rounded" else float(kind) / 100.0
        # Half of the last digit, and rounding of the difference of two decimal numbers.
        return abs(number - claimed) <= 0.5001 * _digit(figure) + share * abs(claimed)


def _split(figure: str) -> tuple[str, int]:
    """Return mantissa and power of ten."""
    number = re.sub(rf"·10(?=[{_RAISED[1]}])", "e", re.sub(rf"^(?={_POWER}$)10", "1e", figure))
    mantissa, _, power = number.translate(str.maketrans(f"{_RAISED[1]}−", f"{_RAISED[0]}-", ",")).partition("e")
    return mantissa, int(power or 0)


def value(figure: str) -> float:
    """Return the number that a figure shows."""
    return WORDS[figure.lower()] if figure.lower() in WORDS else float("{}e{}".format(*_split(figure)))


def _digit(figure: str) -> float:
    mantissa, power = ("", 0) if figure.lower() in WORDS else _split(figure)
    return 10.0 ** (power - len(mantissa.partition(".")[2]))


def rendered(figure: str, number: float) -> str:
    """Return a number in the form of a figure, below 1 with two significant digits or more."""
    if figure.lower() in WORDS:
        return {each: word for word, each in WORDS.items()}.get(round(number), f"{number:.0f}")
    decimals = len(_split(figure)[0].partition(".")[2])
    if "e" in figure:
        return f"{number:.{decimals}e}"
    if re.search(_POWER, figure):
        mantissa, power = f"{number:.{decimals}e}".split("e")
        return f"{mantissa}·10{str(int(power)).translate(str.maketrans(*_RAISED))}"
    if 0.0 < abs(number) < 1.0:
        decimals = max(decimals, 1 - math.floor(math.log10(abs(number))))
    return f"{number:{',' if ',' in figure else ''}.{decimals}f}"


def said(path: str, expression: str) -> list[str]:
    """Return the groups of an expression in a file of the project."""
    return _groups(expression, (ROOT / path).read_text(encoding="utf-8"))


def numbers(command: str, expression: str) -> np.ndarray:
    """Return the groups of an expression in the output of a command, as numbers: a row for each match."""
    return np.array(
        [[value(each) for each in match.groups()] for match in re.finditer(expression, _output(command), re.MULTILINE)]
    )


def _groups(expression: str, text: str) -> list[str]:
    return [group for match in re.finditer(expression, text, re.MULTILINE) for group in match.groups()]


@functools.cache
def _output(command: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        for name in ("examples", "models", "benchmarks"):
            Path(folder, name).symlink_to(ROOT / name)
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        surroundings = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "TERM": "dumb"}
        done = subprocess.run(["bash", "-ec", command], cwd=folder, env=surroundings, text=True, check=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
    return done.stdout


def claims() -> list[Claim]:
    """Return all claims."""
    return [Claim(**each) for each in tomllib.loads((ROOT / "docs/claims.toml").read_text(encoding="utf-8"))["claim"]]


def print_into_pages() -> None:
    """Write the figures of all claims into their pages."""
    for claim in claims():
        text = (ROOT / claim.page).read_text(encoding="utf-8")
        place, figures = claim.place(text), claim.parts[1::2]
        for i in reversed(range(len(figures))):
            text = text[: place.start(i + 1)] + figures[i] + text[place.end(i + 1) :]
        (ROOT / claim.page).write_text(text, encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    """Run claims and print what is found; return 1 if a figure differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.docs.claims", description="Run the claims of the pages.")
    parser.add_argument("words", nargs="*", metavar="WORD", help="in page, text or command; default all claims")
    parser.add_argument("--write", action="store_true", help="write what is found into the file and the pages")
    parser.add_argument(
        "--pages", action="store_true", help="run nothing: write the figures of the file into the pages"
    )
    options = parser.parse_args(arguments)
    differ, table = 0, ROOT / "docs/claims.toml"
    for claim in claims() if not options.pages else []:
        if not all(word in f"{claim.page} {claim.text} {claim.command} {claim.python}" for word in options.words):
            continue
        figures, holds, found = claim.parts[1::2], True, claim.seen
        claimed = ", ".join(figures)
        if not claim.seen:
            try:
                given = claim.found()
                holds, found = all(map(claim.agrees, figures, given)), ", ".join(f"{number:.4g}" for number in given)
                if options.write and not holds:
                    written = [f if claim.agrees(f, n) else rendered(f, n) for f, n in zip(figures, given, strict=True)]
                    table.write_text(
                        table.read_text(encoding="utf-8").replace(claim.text, claim.with_figures(written)),
                        encoding="utf-8",
                    )
                    figures = written
                    differ -= all(map(claim.agrees, figures, given))
            except Exception as error:  # the next one may hold
                holds, found = False, f"{error} {getattr(error, 'output', '')}"
            differ += not holds
        sign = "seen" if claim.seen else "pass" if holds else "FAIL"
        print(f"{sign} {claim.page}: claimed {claimed} [{claim.unit}, {claim.tolerance}], found {found}", flush=True)
        if not holds:
            print(f"     {claim.text!r}\n     {claim.command or claim.python}")
    if options.write or options.pages:
        print_into_pages()
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main())
