"""An attribute of FMI is one line where variables are declared, and one where they are described."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import vdfmu

LINES = {
    "unit/declaration.py": "    maximum: float | None = None\n",
    "fmu/description.py": '        "max": None if variable.maximum is None else text(variable.maximum),\n',
}
"""File to the line of one attribute, that another is written like."""
SCRIPT = """
from vdfmu.compiler.fmu import description
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Derivative, Input, State, Unit

class Lag(Unit):
    u, y = Input("1", nominal=1e3), State("V", 2, nominal=1e-3)
    y_dot = Derivative(y)

    def derivatives(self):
        self.y_dot = self.u - self.y

interface = Interface(Lag, None)
for write in description.model_description, description.model_description_3:
    print(*[each.get("nominal") for each in write(interface, "", "", {}).iter() if "nominal" in each.attrib])
"""


def test_two_lines_add_an_attribute_to_both_descriptions(tmp_path):
    shutil.copytree(Path(vdfmu.__file__).parent, tmp_path / "vdfmu", ignore=shutil.ignore_patterns("__pycache__"))
    for file, line in LINES.items():
        path = tmp_path / "vdfmu" / "compiler" / file
        added = line.replace("maximum", "nominal").replace("max", "nominal")
        path.write_text(path.read_text().replace(line, line + added))
    command, environment = [sys.executable, "-c", SCRIPT], {**os.environ, "PYTHONPATH": str(tmp_path)}
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, env=environment).stdout
    # the input, the states and their starts, each a scalar or an array
    assert said.splitlines() == ["1000.0" + 4 * " 0.001", "1000.0" + 2 * " 0.001"]
