"""What cppcheck and its addon for MISRA C:2012 find in production code; docs/efmi.md explains each kind."""

from itertools import product
from pathlib import Path

import pytest

from tests.compiler.native.conftest import program, run
from tests.extras.efmi.conftest import SHIPPED, SINGLE
from tests.extras.efmi.efmu import Efmu

pytestmark = pytest.mark.heavy

EXPLAINED = {"misra-c2012-8.7", "misra-c2012-8.9", "unusedFunction"}


@pytest.mark.parametrize(("unit", "precision"), [
    *product([*SHIPPED, "examples/units/spline.py"], ["double"]),
    *product([*SINGLE, "examples/units/spline.py"], ["float32"]),
])  # fmt: skip
def test_every_finding_is_explained(short_efmu, unit, precision, tmp_path):
    cppcheck = program("cppcheck", "cppcheck")
    whole = Efmu(short_efmu(unit, precision=precision))
    for name, text in whole.code.items():
        (tmp_path / name).write_bytes(text)
    command = [cppcheck, "--std=c99", "--enable=all", "--addon=misra", "--suppress=missingIncludeSystem", "--quiet",
               "--template={id} {file}:{line} {message}", "--output-file=found.txt", f"{whole.name}.c"]  # fmt: skip
    run(command, cwd=tmp_path, seconds=600)
    findings = (tmp_path / "found.txt").read_text().splitlines()
    assert unit != "controller" or any(line.startswith("misra-c2012-8.9") for line in findings)  # the addon ran
    assert not [line for line in findings if line.split()[0] not in EXPLAINED]
    page = (Path(__file__).parents[3] / "docs" / "efmi.md").read_text(encoding="utf-8")
    assert all(f"`{kind}`" in page for kind in EXPLAINED)
