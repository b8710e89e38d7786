"""What an eFMU holds, and what the official checker says of it."""

import subprocess
import sys
import xml.etree.ElementTree as ET
from hashlib import sha1
from pathlib import Path
from typing import Any

import fmpy
import fmpy.validation
import numpy as np
import pytest
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from tests.compiler.eventful import Relay
from tests.conftest import heavy
from tests.extras.efmi.conftest import SHIPPED
from tests.extras.efmi.efmu import Efmu
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import KernelError, UsageError
from vdfmu.unit import Input, Output, Unit


class Small(Unit):
    """A unit with a number that single precision does not have."""

    u = Input("1", text="input")
    y = Output("1", text="output")

    def outputs(self) -> None:
        """Add the number."""
        self.y = self.u + 1e-60


CHECKER = Path(__file__).with_name("check.py")


def findings(efmu: Path, folder: Path) -> list[str]:
    command = [sys.executable, str(CHECKER), str(efmu)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert "The DoStep function" in done.stdout, done.stdout + done.stderr  # it came to the end of the program
    errors = [line for line in done.stdout.splitlines() if "\033[91m" in line]
    return errors or [f"exit code {done.returncode}"] * (done.returncode != 0)


@pytest.mark.heavy
@pytest.mark.parametrize("unit", ["notch_filter", *heavy("controller")])
def test_checker_finds_nothing(efmu, unit, tmp_path):
    assert not findings(efmu(unit), tmp_path)


@pytest.mark.heavy
@pytest.mark.parametrize("unit", [unit for unit in SHIPPED if unit not in ("controller", "notch_filter")])
def test_checker_finds_nothing_in_the_other_units(short_efmu, unit, tmp_path):
    """The checker's parser takes up to a minute for the text of six joints; its statements are those of two."""
    assert not findings(short_efmu(unit), tmp_path)


@pytest.mark.heavy
def test_checker_finds_nothing_in_a_unit_of_the_papers_arm(efmu, tmp_path):
    assert not findings(efmu("computed_torque", "manipulator_6dof"), tmp_path)


@pytest.mark.heavy
@pytest.mark.parametrize("unit", ["spline", "encoder", "wall", "friction_torque"])
def test_checker_finds_nothing_in_units_of_users(efmu, unit, tmp_path):
    assert not findings(efmu(f"examples/units/{unit}.py"), tmp_path)


@pytest.mark.heavy
def test_checker_sees_faults(efmu, tmp_path):
    whole = Efmu(efmu("controller"))
    broken = tmp_path / "PDController.fmu"
    program = f"eFMU/AlgorithmCode/{whole.name}.alg"
    whole.files[program] = whole.files[program].replace(b"input Real q_d[2]", b"input Real other[2]")
    whole.write(broken)
    assert any("q_d" in line for line in findings(broken, tmp_path))


@pytest.mark.parametrize("precision", ["double", "float32"])
def test_files_are_those_of_the_manifests(efmu, precision):
    efmu_ = Efmu(efmu("disturbance_observer", precision=precision))
    schemas = {
        name: etree.XMLSchema(etree.parse(Path(__file__).parents[3] / "fmu_src/efmi/schemas" / name))
        for name in ("efmiContainerManifest.xsd", "AlgorithmCode/efmiAlgorithmCodeManifest.xsd",
                     "ProductionCode/efmiProductionCodeManifest.xsd")
    }  # fmt: skip
    listed = {"__content.xml": "efmiContainerManifest.xsd"}
    for representation in efmu_.content:
        kind = representation.attrib["kind"]
        manifest = efmu_.files[f"eFMU/{kind}/manifest.xml"]
        assert representation.attrib["checksum"] == sha1(manifest).hexdigest()
        assert representation.attrib["manifestRefId"] == ET.fromstring(manifest).attrib["id"]
        listed[f"{kind}/manifest.xml"] = f"{kind}/efmi{kind}Manifest.xsd"
        for file in ET.fromstring(manifest).iter("File"):
            content = efmu_.files[f"eFMU/{kind}/{file.attrib['name']}"]
            assert file.attrib["checksum"] == sha1(content).hexdigest()
    for name, schema in listed.items():
        schemas[schema].assertValid(etree.fromstring(efmu_.files[f"eFMU/{name}"]))
    assert {name for name in efmu_.files if name.startswith("eFMU/") and "/schemas/" not in name} == {
        "eFMU/__content.xml",
        *(f"eFMU/AlgorithmCode/{name}" for name in ("manifest.xml", "DisturbanceObserverPD.alg")),
        *(f"eFMU/ProductionCode/DisturbanceObserverPD.{end}" for end in ("c", "h", "fmu")),
        "eFMU/ProductionCode/manifest.xml",
    }
    (container,) = efmu_.production.iter("CodeContainer")
    assert container.attrib["floatPrecision"] == {"double": "64-bit", "float32": "32-bit"}[precision]


def test_production_code_has_each_variable_and_method_and_the_interface_of_the_fmu(efmu, planar):
    whole = Efmu(efmu("disturbance_observer"))
    here = {e.attrib["foreignRefId"] for e in whole.production.iter() if "foreignRefId" in e.attrib}
    methods = {m.attrib["id"] for m in whole.algorithm.iter("BlockMethod")}
    assert here == {*whole.variables, *methods, "errorSignals"}
    identifiers = {e.attrib["id"] for e in whole.production.iter() if "id" in e.attrib}
    for element in whole.production.iter():
        for name, value in element.attrib.items():
            if name.endswith("RefId") and name not in ("manifestRefId", "foreignRefId"):
                assert value in identifiers, (element.tag, name, value)


def test_efmu_is_an_fmu_of_the_same_bits_each_time(efmu, planar, tmp_path):
    path = efmu("controller")
    assert not fmpy.validation.validate_fmu(str(path))
    again = build_fmus(planar, tmp_path, units=["controller"], target="efmi", folded=True)["controller"]
    assert again.read_bytes() == path.read_bytes()
    plain = build_fmus(planar, tmp_path, units=["controller"], backend="native", folded=True)["controller"]
    inside = Efmu(path).files["eFMU/ProductionCode/PDController.fmu"]
    assert plain.read_bytes() == inside


@pytest.mark.heavy
def test_words_of_refusal(planar, tmp_path):
    cases: list[tuple[dict[str, Any], str]] = [
        ({"target": "efmi", "units": ["plant", "controller"]}, "target efmi: plant: it has continuous states"),
        ({"target": "efmi", "backend": "python"}, "expected the backend native, got python"),
        ({"target": "c"}, "There is no target 'c'. There are: fmi, efmi."),
        ({"target": "efmi", "precision": "half"}, "precision: must be double or float32, got 'half'."),
        *(
            (
                {"target": "efmi", "precision": "float32", "parameters": {"controller": {"K_p[1]": value}}},
                f"controller: K_p: expected 0 or a size from 1.18e-38 to 3.4e.38, .* got {value!r}".replace("+", "[+]"),
            )
            for value in (1e-60, 1e39)
        ),
        ({"target": "efmi", "precision": "float32", "units": [Small]}, "small: a number of its equations: .* 1e-60"),
        ({"target": "efmi", "step": 0.0}, "step: expected a finite number above 0 s, got 0.0."),
        ({"target": "efmi", "precision": "float32", "units": ["torque_sensor"]}, "torque_sensor: .* number 2147483647"),
        ({"precision": "float32"}, "precision: must be double for FMUs, got 'float32'. Add --target efmi"),
    ]
    for options, words in cases:
        with pytest.raises(UsageError, match=words):
            build_fmus(planar, tmp_path, **dict[str, Any](units=["controller"]) | options, folded=True)


class Matrix(Unit):
    """A product with a large matrix."""

    u = Input("1", 48, "features")
    y = Output("1", 64, "predictions")

    def outputs(self) -> None:
        """Multiply."""
        self.y = np.cos(np.arange(64 * 48.0)).reshape(64, 48) @ self.u


@pytest.mark.parametrize(
    ("unit", "words"),
    [(Relay, "has events; an eFMU is a sampled or memoryless unit"),
     (Matrix, "matrix_outputs: no code can be generated for a product with a large matrix here")],
)  # fmt: skip
def test_units_of_other_kinds_are_refused(unit, words, tmp_path):
    with pytest.raises((UsageError, KernelError), match=words):
        build_fmus(None, tmp_path, units=[unit], target="efmi")
