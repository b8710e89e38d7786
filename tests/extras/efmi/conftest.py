"""eFMUs of the shipped units."""

from functools import cache
from pathlib import Path

import pytest

from tests.conftest import alone
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import find_unit, package_units
from vdfmu.extras.efmi.build import reason_against
from vdfmu.extras.laws.units.laws import iterative_learning

SHIPPED = [name for name, unit in package_units().items() if not reason_against(unit) and name != "wall"]
"""Units of the package without continuous states, which control or observe an arm."""
DOUBLE = {"communication", "torque_noise", "torque_sensor"}
"""Units that draw random numbers, which need double precision."""
SINGLE = [name for name in SHIPPED if name not in DOUBLE]
START = {"momentum_observer": {"damping": 0.01}}
"""With its own damping, 1e-4, whose square a number of single precision does not hold beside 1, it divides by zero."""


def build(unit: str, robot: str, precision: str, folder: Path) -> Path:
    start = {unit: START[unit]} if precision == "float32" and unit in START else {}
    chosen = find_unit(unit)
    fmus = build_fmus(
        load_robot(robot) if chosen.needs_robot() else None, folder, units=[chosen], parameters=start, target="efmi",
        precision=precision, folded=True)  # fmt: skip
    (path,) = fmus.values()
    return path


@pytest.fixture(scope="session")
def efmu(tmp_path_factory, kernel_cache):
    """Return the eFMU of a unit: ``efmu(unit, robot, precision)``."""

    @cache
    def built(unit: str, robot: str = "planar_2dof", precision: str = "double") -> Path:
        with alone(kernel_cache):
            return build(unit, robot, precision, tmp_path_factory.mktemp(f"{robot}_{precision}"))

    return built


@pytest.fixture(scope="session")
def short_efmu(efmu, tmp_path_factory):
    """Return the same, with the text of 5 harmonics where a unit has 20: its statements are the same, a third as many.

    Programs that look at texts take as much less time.
    """
    text = Path(iterative_learning.__file__).read_text(encoding="utf-8")
    assert text.count("HARMONICS = 20") == 1
    path = tmp_path_factory.mktemp("short") / "iterative_learning.py"
    path.write_text(text.replace("HARMONICS = 20", "HARMONICS = 5"), encoding="utf-8")
    return lambda unit, **options: efmu(str(path) if unit == "iterative_learning" else unit, **options)
