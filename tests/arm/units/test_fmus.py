"""Observers and control laws as FMUs: valid in each form, and the same numbers from C as from numpy."""

import html
import subprocess
import sys
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from tests.engine.files import check_file
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit, package_units
from vdfmu.base.errors import UsageError

UNITS = [
    name for name, unit in package_units().items() if unit.__module__.split(".")[-2] in ("laws", "observers", "devices")
]


def test_each_runs_without_python_and_says_what_it_computes():
    assert UNITS
    assert all(find_unit(name).backend == "native" and "::" in find_unit(name).__doc__ for name in UNITS)


def test_a_unit_is_found_without_the_other_units():
    code = "import sys, vdfmu.arm.units as u; u.find_unit('plant'); print(f'{u.__name__}.wall' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_a_unit_of_a_file_is_found_by_its_name(tmp_path):
    folder = tmp_path / "C:"  # as of a path on Windows
    folder.mkdir()
    path = folder / "units.py"
    path.write_text(
        "from vdfmu.unit import Output, Unit\n"
        + "".join(f'class {name}(Unit):\n    """Unit {name}."""\n    y = Output("1")\n' for name in ("One", "Other"))
    )
    assert find_unit(f"{path}:Other").__name__ == "Other"
    with pytest.raises(UsageError, match=r"units\.py has several units: One, Other\. Name one"):
        find_unit(path)
    with pytest.raises(UsageError, match=r"units\.py has no unit 'Third'\. There are: One, Other"):
        find_unit(f"{path}:Third")


@pytest.mark.heavy
@pytest.mark.parametrize("form", ["native 2.0", "native 3.0", "python 2.0"])
@pytest.mark.parametrize("unit", UNITS)
def test_nothing_is_wrong_with_the_fmu(unit, form, general, tmp_path):
    """The check compares an FMU with the results of numpy that are in it."""
    backend, version = form.split()
    path = build_fmus(general, tmp_path, units=[unit], backend=backend, fmi_version=version, folded=True)[unit]
    assert validate_fmu(str(path)) == []
    assert check_file(path) == []
    with zipfile.ZipFile(path) as archive:
        page = html.unescape(archive.read("documentation/index.html").decode())
        assert find_unit(unit).description() in page


@pytest.mark.heavy
def test_the_natural_law_is_the_same_in_c(planar, tmp_path):
    names = [f"phi[{i},{k}]" for i in (1, 2) for k in range(1, 11)] + ["tau[1]", "tau[2]"]
    times = np.arange(200) * 1e-3
    inputs = np.zeros(200, dtype=[("time", float), ("q_d[1]", float), ("q_dot[2]", float), ("q[2]", float)])
    inputs["time"], inputs["q_d[1]"] = times, np.sin(5.0 * times)
    inputs["q[2]"], inputs["q_dot[2]"] = np.sin(3.0 * times), 3.0 * np.cos(3.0 * times)
    runs = []
    for backend in ("native", "python"):
        out = tmp_path / backend
        (path,) = build_fmus(planar, out, units=["virtual_decomposition"], backend=backend, folded=True).values()
        rows = fmpy.simulate_fmu(
            str(path), stop_time=0.2, output_interval=1e-3, start_values={"adaptation": 1}, output=names, input=inputs
        )
        runs.append(np.array([list(row)[1:] for row in rows]))
    assert np.ptp(runs[0][:, 0]) > 1e-3  # it adapts
    # 200 steps of rounding of numbers of order 1 to 10
    np.testing.assert_allclose(runs[0], runs[1], rtol=0, atol=1e-11)
