"""What vdfmu needs of fmpy and pythonfmu. A failure here after an upgrade says which code of vdfmu to look at."""

import ctypes
import importlib.metadata
import inspect
import tomllib
from hashlib import sha256
from pathlib import Path

import fmpy
import numpy as np
import pytest
import pythonfmu
from fmpy import fmi1, fmi3
from fmpy.fmi1 import FMICallException, FMU1Slave
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from tests.wild import build, write
from vdfmu.engine.fmu.versions import Instance1, Instance2, Instance3

ROOT = Path(__file__).parents[2]
LIBRARY = "4be156a552c16f30"
"""Start of the digest of the library of pythonfmu 0.7.0 for Linux."""
STRANGE, NEGATIVE = 8, 9
"""Ways of ``wild.c``: a step returns 17, or -1."""


def test_the_bounds_in_pyproject_end_before_the_next_version_that_may_differ():
    """The methods with FMI's names are undocumented, and the faults of pythonfmu's library are those of 0.7."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"fmpy>=0.3.32,<0.4", "pythonfmu>=0.7,<0.8"} <= {*project["dependencies"]}
    assert importlib.metadata.version("fmpy").startswith("0.3.")
    assert importlib.metadata.version("pythonfmu").startswith("0.7.")


@pytest.mark.parametrize("verb", ["Get", "Set"])
def test_values_are_arrays_with_their_references_before_them(verb):
    """`Instance._call_of` puts the arguments in this order."""
    two = [*inspect.signature(getattr(FMU2Slave, f"fmi2{verb}Real")).parameters]
    three = [*inspect.signature(getattr(FMU3Slave, f"fmi3{verb}Float64")).parameters]
    binary = [*inspect.signature(getattr(FMU3Slave, f"fmi3{verb}Binary")).parameters]
    assert two == ["self", "c", "vr", "nvr", "value"]
    assert three == ["self", "instance", "valueReferences", "nValueReferences", "values", "nValues"]
    assert binary == ["self", "instance", "valueReferences", "nValueReferences", "valueSizes", "values", "nValues"]


def test_statuses_above_warning_are_raised_and_others_returned(tmp_path):
    """`Library.run`, `status_of` and `SampledStepper.advance` rely on it; a status below 0 is returned."""
    library = build(tmp_path)
    for way, status in ((STRANGE, 17), (NEGATIVE, -1)):
        path = write(tmp_path / f"{way}.fmu", library, way)
        description = fmpy.read_model_description(path, validate=False)
        fmu = FMU2Slave(guid=description.guid, modelIdentifier="wild", unzipDirectory=fmpy.extract(path))
        assert isinstance(fmu.dll, ctypes.CDLL) and fmu.component is None  # `CompiledSteps` has addresses from `dll`
        fmu.instantiate()
        arguments = fmu.component, ctypes.c_double(0.0), ctypes.c_double(0.1), True
        if status < 0:
            assert fmu.fmi2DoStep(*arguments) == status
        else:
            with pytest.raises(FMICallException) as raised:
                fmu.fmi2DoStep(*arguments)
            assert (raised.value.function, raised.value.status) == ("fmi2DoStep", status)
        fmu.freeInstance()


def test_fmpy_still_declares_statuses_of_fmi_1_as_texts():
    """Once it does not, remove `Instance1.mend` in vdfmu/engine/fmu/versions.py."""
    for name in ("InitializeSlave", "DoStep", "SetRealInputDerivatives", "GetRealOutputDerivatives"):
        assert inspect.signature(getattr(FMU1Slave, f"fmi1{name}")).return_annotation is fmi1.fmi1String
    assert "fmi1InitializeSlave" in inspect.getsource(FMU1Slave.fmi1SetRealInputDerivatives)


def test_fmpy_still_stays_in_the_folder_of_a_library_that_it_cannot_load(tmp_path, monkeypatch):
    """Once it does not, remove the lock and the folder in `_loaded` of vdfmu/engine/fmu/library.py."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "binaries" / fmpy.platform
    folder.mkdir(parents=True)
    (folder / f"none{fmpy.sharedLibraryExtension}").write_bytes(b"no library")
    with pytest.raises(Exception, match="Failed to load shared library"):
        FMU2Slave(guid="", modelIdentifier="none", unzipDirectory=str(tmp_path))
    assert Path.cwd() == folder


def test_types_of_values_are_ctypes_of_the_sizes_in_the_engine():
    """`module` and `dtypes` of the classes in vdfmu/engine/fmu/versions.py describe the same memory."""
    for kind in (Instance1, Instance2, Instance3):
        for name, dtype in kind.dtypes.items():
            assert ctypes.sizeof(getattr(kind.module, kind.prefix + name)) == np.dtype(dtype).itemsize, (kind, name)
    assert fmi3.fmi3Float64 is ctypes.c_double


def test_the_library_of_pythonfmu_is_the_one_whose_faults_are_made_up_for():
    """Another one: read its PySlaveInstance.cpp beside vdfmu/compiler/fmu/python/wrapper.py; run make test-memory."""
    libraries = Path(pythonfmu.__file__).parent / "resources" / "binaries" / "linux64"
    (library,) = libraries.glob("*.so")
    assert sha256(library.read_bytes()).hexdigest().startswith(LIBRARY)
