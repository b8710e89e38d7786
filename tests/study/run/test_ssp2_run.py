"""A system of SSP 2.0 runs as that of SSP 1.0 does, to the last bit."""

import numpy as np
import pytest

from tests.engine.files import members
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.files import pack_zip
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run import simulate
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packages")
    scenario = load_scenario("planar_tracking")
    fmus = build_fmus(scenario.robot, folder, parameters=system_values(scenario), backend="native", folded=True)
    old = write_ssp(scenario, fmus, folder / "old.ssp")
    content = members(old)
    for name, text in content.items():
        if name.endswith((".ssd", ".ssv", ".ssm")):
            for kind, newer in ((b"Real", b"Float64"), (b"Integer", b"Int32")):
                for prefix in (b"ssc:", b"ssv:"):
                    text = text.replace(b"<" + prefix + kind + b" ", b"<" + prefix + newer + b" ")
                    text = text.replace(b"</" + prefix + kind + b">", b"</" + prefix + newer + b">")
            content[name] = text.replace(b'version="1.0" name', b'version="2.0" name').replace(
                b'ParameterMapping version="1.0"', b'ParameterMapping version="2.0"'
            )
    pack_zip(folder / "new.ssp", content)
    return old, folder / "new.ssp"


@pytest.mark.heavy
def test_the_reader_finds_the_same_system_which_runs_to_the_bit_as_ssp_1(packages):
    old, new = map(load_ssp, packages)
    assert (old.version, new.version) == ("1.0", "2.0")
    assert [str(c) for c in old.connections] == [str(c) for c in new.connections]
    assert {c.type for each in new.components for c in each.connectors.values()} <= {"Float64", "Int32", "Boolean"}
    for earlier, later in zip(old.components, new.components, strict=True):
        assert [(p.name, p.value) for p in earlier.parameters] == [(p.name, p.value) for p in later.parameters]
    old, new = (simulate(path, stop=0.2) for path in packages)
    assert old.names == new.names
    for name in old.names:
        assert np.array_equal(old[name], new[name]), name


@pytest.mark.heavy
def test_ssp_2_is_checked_with_a_run_and_arrays_of_fmi_3_run_as_the_elements_of_fmi_2(packages, tmp_path):
    report = inspect_file(packages[1])
    assert (report.problems, report.standard, report.ran) == ([], "SSP 2.0", True)
    # The package that `vdfmu ssp --format 2.0` writes: arrays are connected, and set, as a whole or by parts.
    scenario = load_scenario("planar_tracking")
    values = system_values(scenario)
    fmus = build_fmus(scenario.robot, tmp_path, parameters=values, backend="native", fmi_version="3.0", folded=True)
    arrays = write_ssp(scenario, fmus, tmp_path / "arrays.ssp", version="2.0")
    assert inspect_file(arrays).problems == []
    old, new = (simulate(path, stop=0.2) for path in (packages[0], arrays))
    assert sorted(old.names) == sorted(new.names)
    for name in old.names:
        assert np.array_equal(old[name], new[name]), name
