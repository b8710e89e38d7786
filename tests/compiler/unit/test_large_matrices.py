"""Products with large matrices of numbers, as in neural nets: calls instead of m n operations."""

import fmpy
import numpy as np
import pytest

from tests.compiler.native.binding import Instance, Model
from tests.conftest import heavy
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import KernelError, UnitError
from vdfmu.compiler import wasm
from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Derivative, Input, Output, State, Unit

RNG = np.random.default_rng(3)
FIRST = (RNG.normal(size=(64, 48)) / 7.0).astype(np.float32)
WIDE, SQUARE, LAST = RNG.normal(size=(48, 2)), RNG.normal(size=(48, 48)) / 7.0, RNG.normal(size=(2, 48)) / 7.0
SECOND = RNG.normal(size=(40, 64)) / 8.0


class Net(Unit):
    """Net of two layers, of which one has numbers of single precision."""

    u = Input("1", 48, "features")
    y = Output("1", 40, "predictions")
    z = Output("1", 64, "first layer, before its law")

    def outputs(self) -> None:
        self.z = FIRST @ self.u
        self.y = SECOND @ np.tanh(self.z)


class Rows(Unit):
    """The same net by rows, as its weights are in other libraries; an input whose name begins as the states' do."""

    x_seen = Input("1", 48, "features")
    y = Output("1", 40, "predictions")
    z = Output("1", 64, "first layer, before its law")

    def outputs(self) -> None:
        self.z = self.x_seen @ FIRST.T
        self.y = np.tanh(self.z) @ SECOND.T


class Flow(Unit):
    """Motion by a net."""

    x = State("1", 2, "state", start=[1.0, -0.5])
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        self.x_dot = LAST @ np.tanh(SQUARE @ np.tanh(WIDE @ self.x)) - 2.0 * self.x


class Timed(Flow):
    """The same with a switch by time."""

    def derivatives(self) -> None:
        self.x_dot = LAST @ np.tanh(SQUARE @ np.tanh(WIDE @ self.x)) * np.floor(self.t)


@pytest.fixture(scope="module", params=["2.0", *heavy("3.0")])
def model(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("net")
    (path,) = build_fmus(None, folder, units=[Net], fmi_version=request.param).values()
    return Model(fmpy.extract(str(path), folder / "net") and folder / "net")


def jacobian(u):
    return SECOND @ (np.diag(1.0 - np.tanh(FIRST @ u) ** 2) @ FIRST)


@pytest.mark.parametrize("cls", [Net, Rows])
def test_the_trace_calls_the_products(cls):
    """48 arguments, 64 + 40 results of calls twice, and 64 tangents, where scalar sums alone would be 11,264."""
    function = Interface(cls, None).functions.casadi_function(f"{cls.__name__.lower()}_outputs")
    assert function.n_instructions() < 400
    u = RNG.normal(size=48)
    made = [each(Interface(cls, None)) for each in (Traced, Plain)]
    for unit in made:
        unit.group("u" if cls is Net else "x_seen")[:] = u
        unit.outputs()
    # 64 terms of less than 1, of which each sum has a rounding
    np.testing.assert_allclose(made[0].group("y"), made[1].group("y"), rtol=0, atol=64 * 2e-16)


def test_an_fmu_has_the_sums_of_the_trace_and_exact_derivatives(model):
    unit, traced = Instance(model).start(), Traced(Interface(Net, None))
    u = RNG.normal(size=48)
    unit.step(0.1, u=u)
    traced.group("u")[:] = u
    traced.outputs()
    assert np.array_equal(unit.get("z"), traced.group("z"))
    # FMUs have an own tanh: rounding of 64 terms of less than 1
    np.testing.assert_allclose(unit.get("y"), traced.group("y"), rtol=0, atol=64 * 2e-16)
    direction, bar = RNG.normal(size=48), RNG.normal(size=40)
    made = unit.directional(unit.model.group("y"), unit.model.of("input"), direction)
    np.testing.assert_allclose(made, jacobian(u) @ direction, rtol=0, atol=1e-13)  # 64 * 48 roundings of less than 1
    if model.major == "3":
        made = unit.adjoint(unit.model.group("y"), unit.model.of("input"), bar)
        np.testing.assert_allclose(made, bar @ jacobian(u), rtol=0, atol=1e-13)
    unit.free()


@pytest.mark.heavy
def test_states_that_move_by_a_net(tmp_path):
    """The solver's Jacobian has the products too."""
    (path,) = build_fmus(None, tmp_path, units=[Flow]).values()
    rows = fmpy.simulate_fmu(str(path), stop_time=1.0, output_interval=1.0, step_size=1.0, start_values={
        "tolerance": 1e-9}, output=["x[1]", "x[2]"])  # fmt: skip
    expected = Flow().simulate(stop=1.0, step=1.0, tolerance=1e-11)["x"][-1]
    # local errors of 1e-9 (1 + x) of some 100 steps, in a motion that contracts
    np.testing.assert_allclose(list(rows[-1])[1:], expected, atol=1e-7)


def test_what_has_no_such_products_says_so():
    function = Interface(Net, None).functions.casadi_function("net_outputs")
    with pytest.raises(KernelError, match="net_outputs: a product with a large matrix is not supported in WebAssembly"):
        wasm.Assembler().traced(function)
    with pytest.raises(UnitError, match="may switch by time: it depends on the time and multiplies by a large matrix"):
        _ = Interface(Timed, None).program
