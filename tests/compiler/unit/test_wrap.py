"""``vdfmu unit from``: units of linear systems, CasADi functions and tables, against scipy, CasADi and numpy."""

import casadi as ca
import fmpy
import numpy as np
import pytest
from scipy import io, signal
from scipy.integrate import solve_ivp

import vdfmu
from tests.compiler.unit.conftest import command
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.wrap import unit_from

A, B = np.array([[-0.2, -4.0], [1.0, 0.0]]), np.array([[1.0, 0.5], [0.0, 1.0]])
C, D = np.array([[0.0, 1.0], [1.0, 1.0], [0.5, 0.0]]), np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 2.0]])
SHAPES = {"a": (2, 3), "s": (3,), "w": (2, 2), "u": (1,), "y": (1,), "x": (2,)}
MATRICES = {"A": A, "B": B, "C": C, "D": D}
DESIGN = """
import casadi as ca
from scipy import signal

class Labelled:
    A, B, C, D, dt = [[-1.0]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]], 0
    input_labels, output_labels, state_labels = ["force", "wind"], ["speed"], ["speed"]

transfer = signal.TransferFunction([1.0], [1.0, 0.2, 4.0])
held = signal.StateSpace([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.5]], dt=0.01)
labelled = Labelled()
other = signal.StateSpace([[0.0, 1.0], [-4.0, -0.2]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
nothing = 3
unsampled = signal.StateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=True)
x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
ode = ca.vertcat(x[1], u - p * ca.sin(x[0]))
pendulum = ca.Function("pendulum", [x, u, p], [ode, x[0] ** 2], ["x", "u", "p"], ["ode", "y"])
a, b = ca.MX.sym("a", 2, 3), ca.MX.sym("b")
maps = ca.Function("maps", [a, b], [b * (a[:, ::-1].T @ ca.DM([1, 2])), a @ a.T], ["a", "b"], ["s", "w"])
wide = ca.Function("wide", [x], [x[0]], ["x"], ["ode"])
diagonal = ca.SX.sym("d", ca.Sparsity.diag(2))
sparse = ca.Function("sparse", [diagonal], [ca.sum1(diagonal)], ["u"], ["y"])
algebraic = ca.Function("algebraic", [x, u], [x, x[0] - u], ["x", "z"], ["ode", "alg"])
solver = ca.Function("solver", [b], [ca.rootfinder("r", "newton", {"x": u, "g": u**2 - 2})(x0=b)["x"]])
"""


@pytest.fixture
def design(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "design.py").write_text(DESIGN)
    return tmp_path


def made(source, name=None):
    """Return an instance of the unit of a source."""
    return find_unit(str(unit_from(source, name)[0]))


@pytest.mark.parametrize("kind", ["mat", "npz"])
def test_a_linear_system_of_a_file_has_the_response_of_scipy(design, kind):
    if kind == "mat":
        io.savemat("plant.mat", MATRICES)
    else:
        np.savez("plant.npz", **MATRICES)
    unit = made(f"plant.{kind}")(x_0=[0.3, -0.1])
    found = unit.simulate({"u": lambda t: np.array([np.sin(t), 1.0])}, stop=2.0, step=1e-2, tolerance=1e-10)
    expected = signal.lsim(
        (A, B, C, D), np.column_stack([np.sin(found.t), np.ones_like(found.t)]), found.t, [0.3, -0.1]
    )
    # lsim takes lines between the samples: the error of sin is 1e-4 / 8 of its amplitude, and the gain below 2
    assert np.abs(found["y"] - expected[1]).max() < 2.5e-5
    model = unit.linearize()
    assert (model.A == A).all() and (model.B == B).all()


def test_the_names_of_python_control_are_in_the_unit(design):
    text = (unit_from("design.py:labelled")[0]).read_text()
    assert "u = Input(\"1\", 2, ['force', 'wind'])" in text and "['speed']" in text


def test_a_discrete_system_gives_the_output_of_each_sample(design):
    io.savemat("digital.mat", {"A": A / 5, "B": B, "C": C, "D": D, "Ts": 0.5})
    for source, system in (
        ("digital.mat", (A / 5, B, C, D, 0.5)),
        ("design.py:held", ([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.5]], 0.01)),
    ):
        unit, dt, m = made(source)(), system[4], np.shape(system[1])[1]
        u = np.random.default_rng(1).normal(size=(20, m))
        unit.start()
        found = []
        for row in u:
            unit.u = row
            unit.update()
            found.append(unit.y)
        assert np.abs(found - signal.dlsim(system, u)[1]).max() < 1e-12
        assert unit.period == dt
        with pytest.raises(UsageError, match="period"):
            type(unit)(period=2 * dt).simulate(stop=2 * dt, step=dt)


def test_a_casadi_function_is_a_unit_with_its_states(design):
    unit = made("design.py:pendulum")(x_0=[1.0, 0.0], p=9.81)
    found = unit.simulate({"u": 0.2}, stop=1.0, tolerance=1e-12)
    function = ca.Function.load("pendulum.casadi")
    end = solve_ivp(
        lambda t, x: function(x, 0.2, 9.81)[0].full()[:, 0], (0.0, 1.0), [1.0, 0.0], "DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    # 1e-12 in each of 1000 steps, and errors grow by exp(3.1) at most
    assert np.abs(found["x"][-1] - end).max() < 3e-8
    assert np.abs(found["y"] - found["x"][:, 0] ** 2).max() < 1e-15


def test_matrices_keep_their_places(design):
    rng = np.random.default_rng(2)
    a = rng.normal(size=(2, 3))
    unit = made("design.py:maps")(a=a, b=2.0)
    unit.outputs()
    assert np.abs(unit.s - 2.0 * a[:, ::-1].T @ [1, 2]).max() < 1e-15
    assert np.abs(unit.w - a @ a.T).max() < 1e-15


def elements(name, value):
    """Return the names in an FMU and the values of a variable's elements; a last axis that is time stays."""
    array = np.asarray(value)
    shape = SHAPES.get(name, ())
    return [
        (f"{name}[{','.join(str(k + 1) for k in index)}]" if index else name, array[index])
        for index in np.ndindex(shape)
    ]


@pytest.mark.heavy
def test_each_kind_as_an_fmu_equals_the_unit(design):
    (design / "table.csv").write_text("T [s],a b [N.m],c\n0,1,2\n1,3,-1\n2.5,4,0\n")
    for source, values in (("table.csv", {"T": 1.7}), ("design.py:maps", {"a": np.arange(6.0).reshape(2, 3), "b": 3.0}),
                           ("design.py:held", {"u": [0.7]}), ("design.py:transfer", {"u": [1.0]}),
                           ("design.py:other", {"u": [2.0]})):  # fmt: skip
        unit = made(source)
        ((_, fmu),) = vdfmu.build_fmus(None, "fmus", units=[unit]).items()
        given = {key: value for name, values_of in values.items() for key, value in elements(name, values_of)}
        found = fmpy.simulate_fmu(str(fmu), stop_time=0.05, output_interval=0.01, start_values=given)
        expected = unit(**values).simulate(stop=0.05, step=0.01, tolerance=1e-10)
        for name in (name for name, one in unit.declared.items() if one.causality == "output"):
            for key, value in elements(name, np.moveaxis(expected[name], 0, -1)):
                # the FMU's solver has a tolerance of 1e-7
                assert np.abs(found[key] - value).max() < 1e-6, (source, key)


def test_a_table_is_linear_between_its_points(design):
    rows = np.column_stack([np.linspace(0.0, 3.0, 40) ** 2, np.random.default_rng(3).normal(size=(40, 2))])
    np.savetxt("data.csv", rows, delimiter=",", header="time,q,w\ns,rad,rad/s", comments="", fmt="%.17g")
    for first in ("time", "x"):
        (design / f"{first}.csv").write_text((design / "data.csv").read_text().replace("time", first))
        unit = made(f"{first}.csv", f"table_of_{first}")()
        found = unit.simulate({} if first == "time" else {"x": lambda t: t}, stop=10.0, step=0.1)
        for name, column in (("q", rows[:, 1]), ("w", rows[:, 2])):
            # slopes up to 1e3, between points as near as 0.006, and two roundings of numbers below 4 in each
            assert np.abs(found[name] - np.interp(found.t, rows[:, 0], column)).max() < 1e-13


@pytest.mark.parametrize(
    ("source", "content", "match"),
    [
        ("none.mat", None, "there is no such file"),
        ("model.txt", "1", "expected model.mat"),
        ("broken.npz", "1", "broken.npz: cannot be read"),
        ("broken.casadi", "1", "broken.casadi: cannot be read"),
        ("design.py:nothing", None, "expected a CasADi function, or a system with A, B, C and D, got int"),
        ("design.py:missing", None, "expected a CasADi function, or .* got NoneType"),
        ("design.py:solver", None, "has more than scalar operations"),
        ("short.csv", "a,b\n1,2\n", "two rows"),
        ("words.csv", "a,b\n1,2\n3,x\n", "row 2: expected 2 finite numbers, got '3,x'"),
        ("back.csv", "a,b\n1,2\n0,3\n", "column a: expected numbers that increase"),
        ("names.csv", "a,b b,b_b\n1,2,3\n2,3,4\n", "column 'b_b': expected another name"),
        ("keyword.csv", "a,lambda\n1,2\n2,3\n", "column 'lambda': expected a name of letters"),
        ("taken.csv", "a,outputs\n1,2\n2,3\n", "column 'outputs': outputs is a name that units have"),
        ("units.csv", "a,b [furlong]\n1,2\n2,3\n", r"column 'b \[furlong\]': expected a unit of measurement"),
        ("code.csv", "a,y [1' if not print() else ']\n1,2\n2,3\n", "expected a unit of measurement"),
        ("empty.npz", "", "empty.npz: cannot be read"),
        ("broken.mat", "MATLAB 5.0", "broken.mat: expected a MATLAB file"),
        ("design.py:wide", None, r"expected ode of the shape of x, \(2, 1\), got \(1, 1\)"),
        ("design.py:sparse", None, "u is sparse"),
        ("design.py:algebraic", None, "alg has to be 0"),
        ("design.py:unsampled", None, "dt: expected the time between samples in s, dt=0.001, got True"),
    ],
)
def test_what_is_wrong_is_said_and_leaves_no_file(design, source, content, match):
    if content is not None:
        (design / source).write_text(content)
    before = sorted(design.iterdir())
    with pytest.raises(UsageError, match=match):
        unit_from(source, trust=True)
    assert sorted(design.iterdir()) == before


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"B": np.ones((3, 1))}, r"B: expected shape \(2, 2\)"),
        ({"C": np.full((3, 2), np.nan)}, "C: expected finite real numbers"),
        ({"A": A * 1j}, "A: expected finite real numbers"),
        ({"D": None}, "expected A, B, C and D, got no D"),
        ({"dt": -1.0}, "dt: expected the time between samples in s, dt=0.001, got -1"),
    ],
)
def test_matrices_that_do_not_fit_are_named(design, change, match):
    io.savemat("wrong.mat", {key: value for key, value in (MATRICES | change).items() if value is not None})
    with pytest.raises(UsageError, match=match):
        unit_from("wrong.mat")


def test_a_file_that_fails_or_ends_is_said(design):
    (design / "fails.py").write_text("1 / 0")
    with pytest.raises(UnitError, match=r"fails\.py: ZeroDivisionError"):
        unit_from("fails.py:x")
    (design / "ends.py").write_text("raise SystemExit(3)")
    with pytest.raises(UnitError, match=r"ends\.py: SystemExit: 3"):
        unit_from("ends.py:x")


def test_names_of_files_and_of_matrices_do_no_harm(design):
    """A quote in a name ended the text of the unit; a class A hid the matrix A."""
    (design / 'q"uo\\Ute.csv').write_text('Time [s];b\n0;1,5\n\n1;"2,5"\n')
    found = made('q"uo\\Ute.csv', "quoted")().simulate(stop=1.0, step=0.5)
    assert found["b"].tolist() == [1.5, 2.0, 2.5]
    io.savemat("plant.mat", MATRICES)
    unit = made("plant.mat", "A")(x_0=[1.0, 0.0])
    unit.start()
    unit.outputs()
    assert (unit.y == C @ [1.0, 0.0]).all()


def test_the_command_names_what_it_wrote(design):
    done = command("unit", "from", "design.py:maps", "--name", "MyMaps")
    assert done.exit_code == 0 and "my_maps.casadi" in done.output and "vdfmu build my_maps.py" in done.output
    again = command("unit", "from", "design.py:maps", "--name", "MyMaps")
    assert again.exit_code == 1 and "not replaced" in str(again.exception)
