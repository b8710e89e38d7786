"""Units of a user: built in each form, they compute what their methods say."""

import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import html

from tests.compiler.native.binding import Instance, Model
from tests.compiler.unit.pair import functions, further, unit_of
from tests.engine.files import check_file
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.extras import extra_modules
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import ScipySolver

FILE = Path(__file__).parent / "own_units.py"
NATIVE = ("native 2.0", "native 3.0")
FORMS = (*NATIVE, "python 2.0")
TRACED = ("LowPass", "Encoder", "Mixer", "Clock", "Weights", "Words", "OnlyParameter", "Tensor", "Rate", "Solves")
a, b = ca.MX.sym("a", 2, 3), ca.MX.sym("b")
MAPS = ca.Function("maps", [a, b], [b * (a[:, ::-1].T @ ca.DM([1, 2])), a @ a.T], ["a", "b"], ["s", "w"])
MADE = {"functions": unit_of(functions), "further": unit_of(further)}
"""Units that no file declares: a Python FMU needs one."""
RUNS = {
    "Words": {"x_0": 0.3, "h_0": -0.1, "w1": 0.2, "y_new": 0.1, "d_x": -0.5},
    "Solves": {"u": [1.0, -2.0, 0.5], "T": 2.0, "x_0": [1.0, 0.0, 0.0]}, "Tensor": {"u": [0.1, 0.2, -0.3, 4.0]},
    "Rate": {"x_0": [0.5, 0.1]}, "functions": {"u": [0.7, -1.3, 2.1]}, "further": {"u": [0.7, -1.3, 2.1]},
}  # fmt: skip
"""Unit to its inputs and parameters; any name will do for a variable, as those of Words show."""
for models in extra_modules("factories"):
    MADE |= {
        "maps": models.casadi_unit(MAPS),
        "held": models.linear_unit([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.5]], 0.01),
        "moving": models.linear_unit([[-0.2, -4.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 1.0]], [[0.0]]),
        "table": models.table_unit({"T [s]": [0.0, 1.0, 2.5], "a b [N.m]": [1.0, 3.0, 4.0], "c": [2.0, -1.0, 0.0]}),
    }
    RUNS |= {
        "maps": {"a": np.arange(6.0), "b": 3.0}, "held": {"u": 0.7}, "moving": {"u": 1.0, "x_0": [0.3, -0.1]},
        "table": {"T": 1.7},
    }  # fmt: skip


@pytest.fixture(scope="module")
def own_fmu(robots, tmp_path_factory):
    @cache
    def build(name: str, form: str) -> Path:
        backend, version = form.split()
        robot = robots["slider_3dof"] if name == "Weights" else None
        out = tmp_path_factory.mktemp(name)
        (path,) = build_fmus(
            robot, out, units=[MADE.get(name, f"{FILE}:{name}")], backend=backend, fmi_version=version, folded=True
        ).values()
        return path

    return build


@pytest.fixture
def instance(own_fmu, tmp_path_factory):
    opened: list[Any] = []

    def instantiate(name: str, form: str, **options: Any) -> Any:
        folder = Path(fmpy.extract(own_fmu(name, form), tmp_path_factory.mktemp("unpacked")))
        opened.append(Instance(Model(folder), **options))
        return opened[-1]

    yield instantiate
    for unit in opened:
        unit.free()


@pytest.fixture(params=FORMS)
def form(request):
    return request.param


@pytest.mark.heavy
@pytest.mark.parametrize("name", TRACED)
def test_nothing_is_wrong_with_the_fmu(own_fmu, name, form):
    path = own_fmu(name, form)
    assert validate_fmu(str(path)) == []
    assert check_file(path) == []


@pytest.mark.heavy
def test_what_cannot_be_traced_becomes_a_python_fmu(own_fmu, instance):
    """Whatever backend is asked for. The same numpy calls on the same numbers give the same bits."""
    path = own_fmu("Equations", "native 2.0")
    assert validate_fmu(str(path)) == []
    assert check_file(path) == []
    unit = instance("Equations", "python 2.0").start(a=0.25)
    for b in ([0.1, -0.2], [10.0, 3.0]):  # below and above the limit
        y = np.linalg.solve(np.array([[2.0, 0.25], [0.25, 1.0]]), b)
        expected = y / np.abs(y).max() if np.abs(y).max() > 1.0 else y
        assert np.array_equal(unit.step(b=b).get("y"), expected)


@pytest.mark.few(3)
@pytest.mark.parametrize("size", [1e-3, 3e-4, 2.5e-3, 7e-3 / 3.0])
@pytest.mark.parametrize("start", [0.0, 0.4137])
def test_samples_are_taken_at_multiples_of_the_period_whatever_the_steps_are(instance, form, size, start):
    """A sample sees the inputs of the step that it lies in, one at the end of a step those of the next."""
    # The rounding, halves to even too, product and quotient are alike in numpy and C: the numbers are the same bits.
    period, increment = 1e-3, 0.01
    inputs = [np.array([np.cos(0.3 * k), 0.005 * k + 0.02]) for k in range(12)]
    unit = instance("Encoder", form).start(start, q=inputs[0])
    newest = late = increment * np.round(inputs[0] / increment)
    taken = 0  # samples so far
    for k, q in enumerate(inputs):
        unit.step(size, q=q)
        while taken * period < (k + 1) * size - 1e-9 * period:
            newest, late, taken = increment * np.round(q / increment), newest, taken + 1
        assert np.array_equal(unit.get("newest"), newest), k
        assert np.array_equal(unit.get("y"), late), k


def test_an_input_is_held_to_its_limits_and_a_unit_without_is_a_function_of_time(instance, form):
    unit = instance("Mixer", form).start(u=[1e3, -1e3])
    with pytest.raises(AssertionError):
        unit.set(u=[0.0, 2e3])
    assert "u[2]: expected at most 1000, got 2000." in unit.messages[-1].text
    assert np.ravel(unit.step().get("y")) == [0.0]
    # The C library's sine and numpy's differ by rounding, 2e-16.
    unit = instance("Clock", form).start(0.5)
    for size in (0.1, 0.25, 1.0):
        assert np.ravel(unit.step(size).get("y")) == pytest.approx(np.sin(2.0 * unit.time), abs=4e-16)


@pytest.mark.heavy
@pytest.mark.parametrize(("name", "form"), [(n, form) for n in RUNS for form in (NATIVE if n in MADE else FORMS)])
def test_a_unit_computes_what_its_methods_do_on_floats(instance, form, name):
    """Against scipy on the unit in numpy; both solve to 1e-10 or better, over less than 1000 steps of damped motion."""
    plain = Plain(Interface(MADE.get(name) or find_unit(f"{FILE}:{name}"), None))
    solver = {"tolerance": 1e-10} if "tolerance" in plain.interface.groups else {}
    unit = instance(name, form).start(**solver, **RUNS[name])
    for group, values in RUNS[name].items():
        plain.group(group)[:] = values
    plain.start()
    motion = ScipySolver(plain)
    for size in (3e-3, 0.01, 0.037):
        motion.move(unit.time, unit.time + size)
        plain.outputs()
        unit.step(size)
        outputs = [i for i, v in enumerate(plain.interface) if v.causality == "output"]
        np.testing.assert_allclose(unit.outputs(), plain.memory[outputs], rtol=1e-13, atol=1e-7 if solver else 1e-13)


@pytest.mark.few(3)
@pytest.mark.parametrize("name", ["Encoder", "Words"])
def test_a_state_saved_within_a_period_repeats_the_run_to_the_bit(instance, form, name):
    """In the instance, and as bytes in another one, which never started."""

    def go_on(unit: Any) -> list[np.ndarray]:
        return [unit.step(size, **{last: 0.01 * k}).outputs() for k, size in enumerate((3e-4, 4e-3, 1e-2))]

    last = "q" if name == "Encoder" else "y_new"
    unit, other = instance(name, form), instance(name, form)
    unit.start(0.0123, **{last: 0.5}).step(3.3e-4, **{last: 0.7})
    time = unit.time
    state = unit.save()
    expected = go_on(unit)
    unit.restore(state).time = time
    repeated = go_on(unit)
    other.restore(other.deserialize(unit.serialize(state)))
    other.time = time
    assert not np.array_equal(expected[0], expected[-1])
    for k, rows in enumerate(expected):
        assert np.array_equal(repeated[k], rows)
    assert np.array_equal(go_on(other), expected)


@pytest.mark.heavy
def test_a_step_that_fails_at_a_later_sample_changes_nothing(instance, form):
    """The count is that before the step, and the step of half the length does what it would have done."""
    unit = instance("Burst", form).start().step(4e-4)
    before = unit.outputs()
    derivatives = unit.read(unit.model.of("local"))
    with unit.refuses("the internal step reached its minimum|is not finite") as refused:
        refused("DoStep", *unit.step_arguments(unit.time, 3e-3))
    assert np.array_equal(unit.outputs(), before)
    assert np.array_equal(unit.read(unit.model.of("local")), derivatives)
    assert unit.step(1e-3).get("count") == 2.0


@pytest.mark.few(1)
def test_the_page_is_made_from_the_docstring(own_fmu, form):
    with zipfile.ZipFile(own_fmu("LowPass", form)) as archive:
        page = html.fromstring(archive.read("documentation/index.html").decode())
        names = set(archive.namelist())
    assert page.findtext(".//p[@class='what']") == "First-order low-pass filter"
    assert [block.text for block in page.iter("pre")] == ["T y_dot = u - y"]
    assert {"u", "y", "T", "y_0", "tolerance"} <= {c.text_content() for c in page.xpath("//td[@class='name']")}
    if form == "python 2.0":
        script = {"resources/vdfmu_low_pass_slave.py", "resources/unit.py", "resources/vdfmu.json"}
        assert script <= names
