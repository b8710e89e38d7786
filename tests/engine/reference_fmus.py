"""The Reference FMUs of the Modelica Association, built from their sources in ``reference_fmus``."""

import re
import subprocess
import zipfile
from pathlib import Path
from typing import NamedTuple

import fmpy

from tests.cc import CC

HERE = Path(__file__).with_suffix("")
_EVERYWHERE = "BouncingBall Dahlquist Feedthrough Resource Stair VanDerPol".split()
VERSIONS = {"1.0": _EVERYWHERE, "2.0": _EVERYWHERE, "3.0": [*_EVERYWHERE, "Clocks", "StateSpace"]}
"""Models by version of FMI."""


class Reference(NamedTuple):
    """A Reference FMU for co-simulation, or for model exchange alone if `exchange`."""

    model: str
    exchange: bool = False

    @property
    def name(self) -> str:
        """Its name in systems."""
        return self.model + "ME" * self.exchange

    def description(self, version: str) -> str:
        """Return its model description."""
        text = (HERE / self.model / f"FMI{version[0]}{'CS' * (version == '1.0')}.xml").read_text()
        tag = r"<CoSimulation\b[^>]*(/>|>.*?</CoSimulation>)"
        return re.sub(tag, "", text, flags=re.DOTALL) if self.exchange else text

    def causalities(self, version: str) -> dict[str, str]:
        """Return the causality of each variable that has one."""
        return dict(re.findall(r'name="([^"]+)"[^>]*?causality="(\w+)"', self.description(version)))

    def build(self, version: str, folder: Path) -> Path:
        """Build the FMU as upstream's CMakeLists.txt does; FMI 1.0 is for co-simulation."""
        number, path = version[0], folder / f"{self.name}_{version[0]}.fmu"
        library = path.with_suffix(fmpy.sharedLibraryExtension)
        places = HERE / self.model, HERE / "include", Path(fmpy.__file__).parent / "c-code"
        flags = ["-std=gnu11", "-O1", "-fvisibility=hidden", "-shared", "-fPIC", f"-DFMI_VERSION={number}"]
        flags += ["-DFMI_COSIMULATION" if number == "1" else "-DDISABLE_PREFIX", *(f"-I{place}" for place in places)]
        sources = [HERE / self.model / "model.c", HERE / "src" / f"fmi{number}Functions.c", HERE / "src/cosimulation.c"]
        subprocess.run([*CC, *flags, "-o", library, *sources, "-lm"], check=True)
        platform = fmpy.platform_tuple if number == "3" else fmpy.platform
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", self.description(version))
            archive.write(library, f"binaries/{platform}/{self.model}{library.suffix}")
            if self.model == "Resource":
                archive.write(HERE / "Resource" / "y.txt", "resources/y.txt")
        return path


BALL, DAHLQUIST, RESOURCE, STAIR, VAN_DER_POL = map(
    Reference, ("BouncingBall", "Dahlquist", "Resource", "Stair", "VanDerPol")
)
