"""Print the figures of the documentation beside what their commands give: ``python -m tests.docs.claims [WORD ...]``.

`docs/claims.toml` has each figure, the text around it, and its command. The pages get their figures from there.
"""

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
WORDS = {"ten": 10, "eleven": 11, "twelve": 12}
_RAISED = "0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"
_POWER = f"10[{_RAISED[1]}]+"
NUMBER = rf"{_POWER}|[-−]?\d+(?:,\d{{3}})*(?:\.\d+)?(?:·{_POWER}|e[-+]?\d+)?|\b(?i:{'|'.join(WORDS)})\b"
"""A number as the pages write it: 0.5, 2,000, 4.6·10⁻¹⁰, 10⁻⁹, 4.56e-10, eleven."""
_BRACED = rf"\{{({NUMBER})\}}"


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
        return re.split(_BRACED if re.search(_BRACED, self.text) else f"({NUMBER})", self.text)

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

    def computed(self) -> list[float]:
        """Return the numbers that the command or the expression gives."""
        if self.command:
            output = _output(self.command)
            outcome = _search(self.find or self.pattern, output[output.index(self.after) :])
        else:
            names = {"np": np, "vdfmu": vdfmu, "ROOT": ROOT, "said": said, "numbers": numbers}
            outcome = eval(self.python, names | vars(quantities))
        result, figures = np.ravel(outcome).astype(float).tolist(), len(self.parts) // 2
        if result and self.tolerance == "at most":
            result = [max(result)] * figures
        if len(result) != figures:
            raise ValueError(f"expected {figures} numbers, got {result}")
        return result

    def agrees(self, figure: str, number: float) -> bool:
        """Whether a number is within the tolerance of a figure."""
        if self.tolerance == "at most":
            return number <= value(figure)
        mantissa, power = _split(figure)
        half = 0.5 * 10.0 ** (power - len(mantissa.partition(".")[2]))
        share = 0.0 if self.tolerance == "rounded" else 0.01 * float(self.tolerance.removesuffix(" %"))
        # Half of the last digit and the share. The factor is for rounding of the difference of two decimal numbers.
        return abs(number - value(figure)) <= 1.0001 * half + share * abs(value(figure))


def _split(figure: str) -> tuple[str, int]:
    if figure.lower() in WORDS:
        return str(WORDS[figure.lower()]), 0
    number = re.sub(rf"·10(?=[{_RAISED[1]}])", "e", re.sub(rf"^(?={_POWER}$)10", "1e", figure))
    mantissa, _, power = number.translate(str.maketrans(f"{_RAISED[1]}−", f"{_RAISED[0]}-", ",")).partition("e")
    return mantissa, int(power or 0)


def value(figure: str) -> float:
    return float("{}e{}".format(*_split(figure)))


def rendered(figure: str, number: float) -> str:
    """Return a number in the form of a figure, below 1 with two significant digits or more."""
    decimals = len(_split(figure)[0].partition(".")[2])
    mantissa, power = f"{number:.{decimals}e}".split("e")
    if re.search(_POWER, figure):
        return f"{mantissa}·10{str(int(power)).translate(str.maketrans(*_RAISED))}"
    if re.search("[0-9]e", figure):
        return f"{mantissa}e{power}"
    if 0.0 < abs(number) < 1.0:
        decimals = max(decimals, 1 - math.floor(math.log10(abs(number))))
    return f"{number:{',' if ',' in figure else ''}.{decimals}f}"


def _search(expression: str, text: str) -> np.ndarray:
    return np.array([[*map(value, match.groups())] for match in re.finditer(expression, text, re.MULTILINE)])


def said(path: str, expression: str) -> np.ndarray:
    return _search(expression, (ROOT / path).read_text(encoding="utf-8"))


def numbers(command: str, expression: str) -> np.ndarray:
    return _search(expression, _output(command))


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
    return [Claim(**row) for row in tomllib.loads((ROOT / "docs/claims.toml").read_text(encoding="utf-8"))["claim"]]


def write(claim: Claim, figures: list[str]) -> None:
    """Write the figures of a claim into `docs/claims.toml` and its page."""
    parts, form = claim.parts, "{{{}}}" if re.search(_BRACED, claim.text) else "{}"
    parts[1::2] = map(form.format, figures)
    table, page = ROOT / "docs/claims.toml", ROOT / claim.page
    text = page.read_text(encoding="utf-8")
    place = claim.place(text)
    for i in reversed(range(len(figures))):
        text = text[: place.start(i + 1)] + figures[i] + text[place.end(i + 1) :]
    page.write_text(text, encoding="utf-8")
    table.write_text(table.read_text(encoding="utf-8").replace(claim.text, "".join(parts)), encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    """Run claims and print what is found; return 1 if a figure of the file differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.docs.claims", description="Run the claims of the pages.")
    parser.add_argument("words", nargs="*", metavar="WORD", help="in page, text or command; default all claims")
    parser.add_argument("--write", action="store_true", help="write what is found into the file and the pages")
    options, differ = parser.parse_args(arguments), 0
    for claim in claims():
        if not all(word in f"{claim.page} {claim.text} {claim.command} {claim.python}" for word in options.words):
            continue
        figures, sign, shown = claim.parts[1::2], "seen", claim.seen
        if not claim.seen:
            try:
                values = claim.computed()
                agree, shown = [*map(claim.agrees, figures, values)], ", ".join(f"{number:.4g}" for number in values)
                if options.write:
                    rows = zip(figures, agree, values, strict=True)
                    written = [figure if agrees else rendered(figure, number) for figure, agrees, number in rows]
                    write(claim, written)
                    agree = [*map(claim.agrees, written, values)]
            except Exception as error:  # the next one may hold
                agree, shown = [False], f"{error} {getattr(error, 'output', '')[-500:]}"
            sign = "pass" if all(agree) else "FAIL"
        differ += sign == "FAIL"
        claimed = f"claimed {', '.join(figures)} [{claim.unit}, {claim.tolerance}]"
        print(f"{sign} {claim.page}: {claimed}, found {shown}", flush=True)
        if sign == "FAIL":
            print(f"     {claim.text!r}\n     {claim.command or claim.python}")
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main())
