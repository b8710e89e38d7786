"""The FMUs are valid: fmpy's validator, the schemas, sources that compile anywhere, and nothing but FMI exported."""

import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.build import build_platform_binary
from fmpy.util import read_csv
from fmpy.validation import validate_fmu

from tests.compiler.exports import REFERENCE, elf_exports
from tests.compiler.native.binding import Instance, Model
from tests.compiler.native.conftest import program, run
from tests.compiler.native.driven import drive
from tests.compiler.native.fmi_types import HEADERS, signatures
from tests.conftest import heavy
from vdfmu.engine.fmu.description import inspect_description
from vdfmu.engine.package.archive import Archive


@pytest.mark.few(5)
def test_the_validator_of_fmpy_has_nothing_to_say_and_an_fmu_holds_what_the_standard_says(
    native_fmu, unit_name, version, robot_name
):
    assert validate_fmu(str(native_fmu(unit_name, version, robot_name))) == []
    with zipfile.ZipFile(native_fmu(unit_name, version)) as archive:
        names = set(archive.namelist())
        assert archive.testzip() is None
    assert {"modelDescription.xml", "documentation/index.html", "documentation/licenses/license.txt"} <= names
    assert f"sources/fmi{version[0]}.c" in names
    assert f"sources/fmi{5 - int(version[0])}.c" not in names
    assert any(name.startswith("extra/org.fmi-standard.fmi-ls-ref/") for name in names)
    assert not any(name.startswith("resources/") for name in names)
    standard = {"binaries", "documentation", "extra", "modelDescription.xml", "sources", "terminalsAndIcons"}
    assert {name.split("/")[0] for name in names} - standard <= {"icon.png", "icon.svg", "model.png"}


@pytest.mark.skipif(fmpy.system != "linux", reason="reads ELF, the format of Linux libraries")
def test_only_the_functions_of_fmi_are_exported(model, unit_name, version):
    names = elf_exports(Path(model(unit_name, version).library._name).read_bytes())
    assert names == {f"fmi{version[0]}{name}" for name in signatures(version)}


@pytest.mark.heavy
def test_the_sources_link_with_prefixes_into_one_program(model, tmp_path, version):
    """The functions of two units have their model identifiers as prefix, as the standard says for source code."""
    # Their other names are hidden in one object a unit. fmpy's header of FMI 2.0 leaves the prefix out; the official
    # one has it, and the line is put back here.
    gcc, major = program("gcc", "gcc"), version[0]
    for header in HEADERS.glob(f"fmi{major}*.h"):
        text = header.read_text(encoding="utf-8", errors="replace")
        pasting = "#define paste(a, b) a##b\n#define pasteB(a, b) paste(a, b)\n"
        pasting += "#define fmi2FullName(name) pasteB(FMI2_FUNCTION_PREFIX, name)"
        (tmp_path / header.name).write_text(text.replace("#define fmi2FullName(name) name", pasting), encoding="utf-8")
    names: list[str] = []
    for unit in ("trajectory", "controller"):
        fmu = model(unit, version)
        folder, out = fmu.folder / "sources", tmp_path / unit
        out.mkdir()
        run([gcc, "-std=c11", "-c", f"-I{tmp_path}", f"-I{folder}", *sorted(folder.glob("*.c"))], cwd=out)
        run([program("ld", "binutils"), "-r", *sorted(out.glob("*.o")), "-o", tmp_path / f"{unit}.o"])
        run([program("objcopy", "binutils"), "-w", f"--keep-global-symbol={fmu.name}_fmi*", tmp_path / f"{unit}.o"])
        names.append(f"{fmu.name}_fmi{major}GetVersion")
    declared = "".join(f"const char *{name}(void);\n" for name in names)
    body = "".join(f"    puts({name}());\n" for name in names)
    (tmp_path / "main.c").write_text(f"#include <stdio.h>\n{declared}int main(void)\n{{\n{body}    return 0;\n}}\n")
    run([gcc, "main.c", "trajectory.o", "controller.o", "-o", "main", "-lm"], cwd=tmp_path)
    assert run([tmp_path / "main"]).split() == [version, version]


@pytest.mark.heavy
@pytest.mark.parametrize("unit", ["plant", "trajectory"])
def test_fmpy_compiles_the_sources_and_the_result_computes_the_same(native_fmu, model, tmp_path, unit, version):
    """With cmake and the system's compiler."""
    # The importer's compiler may contract products and sums on processors that can; on x86-64 it does not. 20 steps of
    # some ten internal ones, 1e-16 each of states up to 100: 1e-11.
    program("cmake", "cmake")
    folder = Path(fmpy.extract(native_fmu(unit, version), tmp_path / "fmu"))
    for binary in (folder / "binaries").rglob("*.*"):
        binary.unlink()
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, build_dir=tmp_path / "build")
    actual, expected = (Instance(each).start() for each in (Model(folder), model(unit, version)))
    actual, expected = (drive(instance, 0, 20) for instance in (actual, expected))
    np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-11)


# The table has 12 digits: 5e-12. Rounding is less. The plant: its solver runs at 1e-9, and what amplifies a local error
# over 0.2 s is below 1e3.
BOUND = {"trajectory": 1e-11, "feedforward": 1e-11, "controller": 1e-11, "estimator": 1e-11, "plant": 1e-6}


@pytest.mark.parametrize("robot", ["planar_2dof", *heavy("slider_3dof")])
def test_the_unit_makes_the_reference_results(native_fmu, model, robot, unit_name):
    fmu = model(unit_name, "2.0", robot)
    folder = fmu.folder / REFERENCE
    expected = read_csv(folder / f"{fmu.name}_out.csv")
    inputs = folder / f"{fmu.name}_in.csv"
    names = expected.dtype.names[1:]
    for kind in ("CoSimulation", "ModelExchange")[: 1 + (unit_name == "plant")]:
        result = fmpy.simulate_fmu(
            str(native_fmu(unit_name, "2.0", robot)), fmi_type=kind, stop_time=expected["time"][-1],
            output_interval=expected["time"][1], relative_tolerance=1e-9, output=names,
            input=read_csv(inputs) if inputs.exists() else None,
        )  # fmt: skip
        # model exchange has a row before each change of the inputs and one after it
        rows = [int(np.flatnonzero(np.isclose(result["time"], t))[0]) for t in expected["time"]]
        # CVODE too bounds the local error of a step, in a norm of its own
        factor = 100.0 if kind == "ModelExchange" else 1.0
        for name in names:
            error = np.abs(result[name][rows] - expected[name]) / (1.0 + np.abs(expected[name]))
            assert error.max() < factor * BOUND[unit_name], name


def test_the_engine_reads_each_element_of_the_states(native_fmu, version):
    with Archive(native_fmu("plant", version), "Plant.fmu") as archive:
        description, problems = inspect_description(archive, "Plant.fmu")
    assert problems == [] and description is not None
    assert sum(size for _, _, size in description.states) == 4 * 2  # of planar_2dof
