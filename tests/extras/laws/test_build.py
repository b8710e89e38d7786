"""Units of the extra are built by their names, as those of the core."""

import pytest

from tests.warm import command


@pytest.mark.parametrize("name", ["notch_filter", "NotchFilter"])
def test_a_unit_is_built_by_its_name(tmp_path, name):
    built = command("build", name, "--robot", "planar_2dof", "--backend", "python", "--out", "fmus", cwd=tmp_path)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "fmus" / "NotchFilter.fmu").is_file()
