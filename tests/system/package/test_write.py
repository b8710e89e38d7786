"""The package that is written: valid, complete, and read back with the same content."""

import zipfile

import numpy as np
import pytest

from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.package.parse import parse_ssp_xml
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run import check_system
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import override, system_values


def test_every_xml_of_the_package_is_valid(scenario, fmus, tmp_path):
    path = write_ssp(scenario, fmus, tmp_path / "system.ssp")
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        for name in names:
            if name.endswith((".ssd", ".ssv", ".ssm")):
                parse_ssp_xml(archive.read(name), name[-3:], name)  # raises if it is not valid
    assert sorted(names) == sorted(
        ["SystemStructure.ssd", "documentation/index.html", "resources/start.ssv", "resources/plant.start.ssm"]
        + ["resources/robot.ssv", "resources/controller.robot.ssv"]
        + [f"resources/{path.name}" for path in fmus.values()]
        + [f"resources/{unit}.scenario.ssv" for unit in fmus]
        + [f"resources/icons/{unit}.svg" for unit in fmus]
    )


def test_reading_back_gives_the_values_in_their_units(scenario, fmus, tmp_path):
    system = load_ssp(write_ssp(scenario, fmus, tmp_path / "system.ssp"))
    assert not system.problems
    written = system_values(scenario)
    for component in system.components:
        table = Interface(shipped_units()[component.name], scenario.robot)
        read = {p.name: p for p in component.parameters}
        assert set(read) == set(written[component.name])
        for name, parameter in read.items():
            assert parameter.value == written[component.name][name]
            assert (parameter.unit.name if parameter.unit else None) == table.find(name).unit


def test_the_system_passes_the_check_before_a_run(scenario, fmus, tmp_path):
    checked = check_system(load_ssp(write_ssp(scenario, fmus, tmp_path / "system.ssp")), algorithm="gauss-seidel")
    order = list(checked.schedule.units)
    assert order.index("feedforward") < order.index("controller") < order.index("plant")
    # the only inputs left open are the components of the wrenches, and these have values
    assert checked.notes == ()


def test_every_signal_of_a_connected_group_is_connected(fmus, tmp_path):
    scenario = load_scenario("planar_tracking")
    system = load_ssp(write_ssp(scenario, fmus, tmp_path / "system.ssp"))
    fed = {c.end for c in system.connections}
    expected = {
        (unit, v.name)
        for unit in fmus
        for v in Interface(shipped_units()[unit], scenario.robot)
        if v.causality == "input" and v.group not in ("F_e", "F_e_d")
    }
    assert fed == expected


def test_the_same_scenario_gives_the_same_bytes(scenario, fmus, tmp_path):
    first = write_ssp(scenario, fmus, tmp_path / "a.ssp").read_bytes()
    assert write_ssp(scenario, fmus, tmp_path / "b.ssp").read_bytes() == first


def test_plant_factors_reach_the_plant_alone_and_a_setting_without_an_index_all_joints(scenario):
    values = system_values(load_scenario("two_joint"))
    nominal = load_scenario("two_joint").robot
    factors = load_scenario("two_joint").plant_factors
    assert values["feedforward"]["mass[1]"] == nominal.mass[0]
    # one multiplication: equal to rounding of the product
    assert values["plant"]["mass[1]"] == pytest.approx(nominal.mass[0] * float(np.ravel(factors["mass"])[0]), rel=1e-15)
    assert override(scenario, {"controller.K_p": "3000"}) == {"controller": {"K_p[1]": 3000.0, "K_p[2]": 3000.0}}
    assert override(scenario, {"controller.K_p[2]": "10"}) == {"controller": {"K_p[2]": 10.0}}
    assert override(scenario, {"feedforward.mode": "vdc"}) == {"feedforward": {"mode": 1}}
    assert override(scenario, {"plant.equilibrium": "false"}) == {"plant": {"equilibrium": False}}


def test_an_input_that_nothing_feeds_is_set_as_a_parameter(scenario, fmus, tmp_path):
    values = system_values(scenario, {"plant.F_e[3]": 30.0})
    assert [values["plant"][f"F_e[{k}]"] for k in range(1, 7)] == [0.0, 0.0, 30.0, 0.0, 0.0, 0.0]
    with pytest.raises(UsageError, match=r"plant\.tau: tau\[1\] is a connected input of plant; only para"):
        override(scenario, {"plant.tau": 1.0})
    checked = check_system(load_ssp(write_ssp(scenario, fmus, tmp_path / "system.ssp", values)))
    assert {v.name: value for v, value in checked.starts["plant"]}["F_e[3]"] == 30.0


def test_all_wrong_settings_are_reported_at_once(scenario):
    with pytest.raises(UsageError) as caught:
        override(scenario, {"controller.K_p": "nan", "plant.ell[2]": "0", "plant.mass": "3", "motor.K_p": "1"})
    first, second, third = str(caught.value).splitlines()
    assert first == "controller.K_p: expected a finite number, got nan N.m/rad."
    assert second == "plant.ell[2]: expected at least 1, got 0."  # its unit is 1
    assert third.startswith("motor.K_p: expected component.parameter")


def test_a_package_that_cannot_be_written_says_so(scenario, fmus, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(VdfmuError, match=r"cannot be written.*Choose another folder"):
        write_ssp(scenario, fmus, tmp_path / "file" / "system.ssp")
