"""An attribute of FMI is one line where variables are declared, and one where they are described."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import vdfmu

EDITS = {
    "unit/declaration.py": ("    maximum: float | None = None", "    nominal: float | None = None"),
    "fmu/description.py": (
        '        "max": None if variable.maximum is None else text(variable.maximum),',
        '        "nominal": None if variable.nominal is None else text(variable.nominal),',
    ),
}
"""File to the line after which a line is added."""
SCRIPT = """
from vdfmu.compiler.fmu import description, description3
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Derivative, Input, State, Unit

class Lag(Unit):
    u = Input("1", nominal=1e3)
    y = State("V", 2, nominal=1e-3)
    y_dot = Derivative(y)

    def derivatives(self):
        self.y_dot = self.u - self.y

interface = Interface(Lag, None)
for write in description.model_description, description3.model_description_3:
    print([each.get("nominal") for each in write(interface, "", "", {}).iter() if "nominal" in each.attrib])
"""


def test_two_lines_add_an_attribute_to_both_descriptions(tmp_path):
    shutil.copytree(Path(vdfmu.__file__).parent, tmp_path / "vdfmu", ignore=shutil.ignore_patterns("__pycache__"))
    for file, (line, added) in EDITS.items():
        path = tmp_path / "vdfmu" / "compiler" / file
        text = path.read_text()
        assert text.count(f"{line}\n") == 1
        path.write_text(text.replace(line, f"{line}\n{added}"))
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    # the input, the states and their starts
    scalars, arrays = ["1000.0"] + 4 * ["0.001"], ["1000.0"] + 2 * ["0.001"]
    assert done.stdout.splitlines() == [str(scalars), str(arrays)]
