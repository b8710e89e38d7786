"""An option of a run is declared in one file: Python, commands, help and the master know it then."""

import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vdfmu
from vdfmu.base.option import declared
from vdfmu.engine.options import SimulateOptions
from vdfmu.engine.package_run import run_system
from vdfmu.engine.run import simulate
from vdfmu.engine.run.simulator import Simulator
from vdfmu.study.options import ScenarioRunOptions, SweepOptions

ROOT = Path(vdfmu.__file__).resolve().parents[1]
DECLARED = """    label: Annotated[str | None, Option("Toy: name of the run in its summary.")]
    adaptive: """
ACTS = """"label": self._options["label"],
                "system": """


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Return what runs Python with a copy of the package that has one more option, and where it acts."""
    folder = tmp_path_factory.mktemp("tree")
    tree = folder / "vdfmu"
    for data in ("fmu_src", "models", "ssp"):
        (folder / data).symlink_to(ROOT / data)
    shutil.copytree(ROOT / "vdfmu", tree, ignore=shutil.ignore_patterns("__pycache__"))
    for name, old, new in (("options.py", "    adaptive: ", DECLARED), ("run/simulator.py", '"system": ', ACTS)):
        path = tree / "engine" / name
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1
        path.write_text(text.replace(old, new), encoding="utf-8")

    def run(*arguments, code="from vdfmu.cli import main; main()"):
        done = subprocess.run(
            [sys.executable, "-c", f"import sys\nsys.path.insert(0, {str(folder)!r})\n{code}", *arguments],
            capture_output=True, encoding="utf-8", cwd=folder, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.mark.heavy
def test_a_new_option_is_declared_in_one_file(python, pack, tmp_path):
    components = ["r Ramp y:output", "g Gain u:input y:output"]
    package = pack(components, ["r.y -> g.u"])
    imports = "import vdfmu\nfrom vdfmu.engine.run import simulate\n"
    functions = "vdfmu.run, vdfmu.sweep, simulate"
    shown = python(code=f"{imports}for f in ({functions}): help(f)")
    assert shown.count("label : str, optional\n        Toy: name of the run in its summary.") == 3
    assert len(re.findall(r"label: '?str \| None'? = None", shown)) == 3  # without quotes from Python 3.14 on
    commands = ["run", "--help"], ["run", "x.ssp", "--help"], ["sweep", "run", "--help"]
    invoke = "from click.testing import CliRunner\nfrom vdfmu.cli.commands import app\n"
    code = f"{invoke}for words in {commands}: print(CliRunner().invoke(app, words).output)"
    assert len(re.findall("--label .* Toy: name", python(code=code))) == 3
    runs = f"simulate({str(package)!r}, step=0.1, stop=1.0, label='mine')"
    code = f"from vdfmu.engine.run import simulate\nprint({runs}.summary['label'])"
    assert python(code=code) == "mine\n"
    python("run", str(package), "--step", "0.1", "--stop", "1", "--label", "typed", "--out", str(tmp_path / "out"))
    assert '"label": "typed"' in (tmp_path / "out" / "summary.json").read_text()


@pytest.mark.heavy
def test_the_run_of_a_scenario_and_its_sweep_pass_it_to_the_master(python):
    assert python(
        code="import vdfmu\nfrom vdfmu.study.sweeps.plan import make_plan\n"
        "print(vdfmu.run('planar_tracking', stop=0.02, out=False, label='mine').summary['label'])\n"
        "plan = make_plan('planar_tracking', {'controller.K_p[1]': '1, 2'}, stop=0.02, label='kept')\n"
        "print(plan.job.systems[0].options['label'])"
    ) == "mine\nkept\n"  # fmt: skip


@pytest.mark.parametrize(("function", "options"), [
    (vdfmu.run, ScenarioRunOptions), (simulate, SimulateOptions), (vdfmu.sweep, SweepOptions),
])  # fmt: skip
def test_help_names_each_option_with_type_default_and_sentence(function, options):
    text, parameters = inspect.getdoc(function), inspect.signature(function).parameters
    assert text is not None and "**options" not in text and "options" not in parameters
    for each in declared(options):
        assert parameters[each.name].default == each.option.default
        assert parameters[each.name].annotation == each.annotation
        assert f"\n{each.name} : " in text
        assert " ".join(each.option.text.split()) in " ".join(text.split())


def test_an_option_that_there_is_not_is_refused():
    for function in (vdfmu.run, simulate, vdfmu.sweep, run_system, Simulator):
        words = rf"{function.__name__}\(\) got an unexpected keyword argument 'stepp'"
        with pytest.raises(TypeError, match=words):
            function("tracking", stepp=0.1)
    with pytest.raises(TypeError, match="'recrod'; did you mean record"):
        simulate("tracking.ssp", recrod=["plant.q"])
    with pytest.raises(TypeError, match=r"simulate\(\) too many positional arguments"):
        simulate("tracking.ssp", 0.1)
