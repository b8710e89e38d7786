"""Versions of the standards FMI and SSP, and their differences."""

from __future__ import annotations

from typing import NamedTuple


class FmiVersion(NamedTuple):
    """A version of FMI for which FMUs are built. A new one needs a row in `FMI_VERSIONS`."""

    name: str
    """Version in a model description."""
    prefix: str
    """Prefix of functions, headers and the C file of an FMU, ``fmi2``."""
    token: str
    """Attribute of a model description that identifies the FMU's content."""
    arrays: bool
    """Whether a variable can be an array; if not, each element is a variable."""
    platform_tuples: bool
    """Whether the folders in ``binaries`` are named by platform tuples."""
    build_description: bool
    """Whether ``sources/buildDescription.xml`` lists the C files; if not, the model description does."""
    picture: bool
    """Whether an FMU has a picture ``model.png``."""
    time_variable: bool
    """Whether the time is a variable."""
    adjoints: bool
    """Whether an FMU has adjoint derivatives in addition to directional ones."""
    input_derivatives: bool
    """Whether inputs of co-simulation can have derivatives."""
    enumeration: str
    """Type in the names of functions that get and set an enumeration."""


FMI_1 = FmiVersion("1.0", "fmi1", "guid", False, False, False, False, False, False, True, "Integer")
FMI_2 = FmiVersion("2.0", "fmi2", "guid", False, False, False, True, False, False, True, "Integer")
FMI_3 = FmiVersion("3.0", "fmi3", "instantiationToken", True, True, True, False, True, True, False, "Int64")
FMI_VERSIONS = {version.name: version for version in (FMI_2, FMI_3)}
"""Name to version."""
MASTER_VERSIONS = {FMI_1.name: FMI_1, **FMI_VERSIONS}
"""Name to version, for FMUs that the master runs; FMI 1.0 only for co-simulation."""
PYTHON_FMI = FMI_2
"""Version of FMUs in Python."""
WITHOUT_NATIVE = "FMUs are in Python: a run takes about 20 times as long, and they run only where vdfmu is installed"
"""Consequence of a missing C compiler, the extra ``native``."""


class SspFormat(NamedTuple):
    """A version of SSP for packages. A new one needs a row in `SSP_FORMATS`."""

    name: str
    """Version in the files of a package."""
    fmi: FmiVersion
    """FMI version of FMUs in packages written here. It defines the types of connectors and parameters."""
    schemas: tuple[str, str]
    """Python package with the XML schemas, and their folder in it."""
    always_validated: bool
    """Whether that package is always installed; then written files are validated too."""
    binary_parameters: bool
    """Whether parameters can be binary."""
    more_connections: bool
    """Whether connectors can be constants, local or without a kind (table "Allowed connections" of 2.0)."""


SSP_1 = SspFormat("1.0", FMI_2, ("fmpy", "ssp/schema"), True, False, False)
SSP_2 = SspFormat("2.0", FMI_3, ("pyssp_standard", "resources/ssp2"), False, True, True)
SSP_FORMATS = {form.name: form for form in (SSP_1, SSP_2)}
"""Name to version."""
BACKENDS = ("python", "native")
"""Languages of FMUs."""
