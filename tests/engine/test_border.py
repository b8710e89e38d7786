"""The engine stands alone: it imports nothing of the arm, and a foreign package is run and checked without it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import vdfmu

ROOT = Path(vdfmu.__file__).parent
ALLOWED = {
    "vdfmu", "vdfmu.base.arrays", "vdfmu.base.bars", "vdfmu.base.errors", "vdfmu.base.files", "vdfmu.base.interrupt", "vdfmu.base.measure",
    "vdfmu.base.process", "vdfmu.base.progress", "vdfmu.base.style", "vdfmu.base.temporary", "vdfmu.base.text",
    "vdfmu.base.thinning",
}  # fmt: skip
ARM = (
    "casadi",
    "matplotlib",
    "vdfmu.arm.robot",
    "vdfmu.arm.equations",
    "vdfmu.system.scenario",
    "vdfmu.compiler.functions",
    "vdfmu.compiler.unit",
)


def imported(path: Path) -> set[str]:
    """Return the modules of the package that a file imports, `vdfmu` for names such as its version."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            found.add(str(node.module))
    return {name for name in found if name.partition(".")[0] == "vdfmu"}


def test_the_engine_imports_nothing_of_the_arm():
    files = sorted((ROOT / "engine").rglob("*.py"))
    assert len(files) > 20
    for path in files:
        outside = {name for name in imported(path) if not name.startswith("vdfmu.engine")}
        assert outside <= ALLOWED, f"{path.relative_to(ROOT)} imports {outside - ALLOWED}"


def test_what_the_engine_imports_of_the_package_imports_nothing_of_the_arm_either():
    for name in ALLOWED - {"vdfmu"}:
        assert imported(ROOT / f"{name.removeprefix('vdfmu.')}.py") <= ALLOWED, name


@pytest.mark.parametrize(
    "code",
    [
        "import vdfmu\nvdfmu.simulate(PATH, stop=0.2, step=0.1)",
        "sys.argv[1:] = ['simulate', PATH, '--stop', '0.2', '--step', '0.1', '--out', OUT]\nrun()",
        "sys.argv[1:] = ['check', PATH]\nrun()",
    ],
    ids=["simulate", "vdfmu simulate", "vdfmu check"],
)
def test_a_foreign_package_loads_neither_the_arm_nor_its_libraries(pack, xml, tmp_path, code):
    path = pack(
        [xml.component("r", "Ramp", "y:output"), xml.component("g", "Gain", "u:input")], ["r.y -> g.u"]
    )
    script = (
        f"import json, sys\nPATH, OUT = {str(path)!r}, {str(tmp_path / 'out')!r}\n"
        "def run():\n"
        "    from vdfmu.cli import main\n"
        "    try:\n        main()\n"
        "    except SystemExit as end:\n        assert not end.code, end.code\n"
        f"{code}\nprint()\nprint(json.dumps(sorted(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    loaded = json.loads(done.stdout.splitlines()[-1])
    assert "vdfmu.engine.run.master" in loaded or "check" in code
    assert [name for name in loaded if name.startswith(ARM)] == []
