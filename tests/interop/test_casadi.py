"""CasADi's importer of FMUs: the plant's right-hand side and its derivatives."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.program import UnitFunctions

VERSION = tuple(int(number) for number in ca.CasadiMeta.version().split("."))
SEEN = pytest.mark.skipif(VERSION < (3, 8, 2), reason="docs/interop.md has the importer of CasADi 3.8.2")

SWING = """
import numpy as np
from vdfmu.unit import Derivative, Input, Parameter, State, Unit

class Swing(Unit):
    F = Input("N")
    k = Parameter("N/m", start=3.0)
    x, v = State("m"), State("m/s")
    der_x, der_v = Derivative(x), Derivative(v)

    def derivatives(self):
        self.der_x = self.v
        self.der_v = self.F * np.cos(self.x) - self.k * self.x**3 - np.tanh(self.v)
"""


def traced_rate(robot):
    """Return ``rate(x, u)`` of the plant as it is traced: states and their derivatives, u = (tau, F_e)."""
    function = UnitFunctions(shipped_units()["plant"], robot).casadi_function("plant_derivatives")
    x, tau, F_e = (ca.SX.sym(name, function.size1_in(name)) for name in ("x", "tau", "F_e"))
    rate = function(robot.values(), x, tau, F_e)
    return ca.Function("rate", [x, ca.vertcat(tau, F_e)], [rate], ["x", "u"], ["ode"])


def imported_rate(fmu, **options):
    """Return the same function of the plant's FMU in CasADi's importer.

    Without ``new_forward`` derivatives along a direction are products with the Jacobian. The importer's own, as of
    CasADi 3.8.2, repeats the last answer where a direction is all zero.
    """
    return ca.DaeBuilder("plant", str(fmu), {}).create("rate", ["x", "u"], ["ode"], {"new_forward": False} | options)


@pytest.fixture(scope="module")
def rates(tmp_path_factory):
    robot = load_robot("planar_2dof")
    fmu = build_fmus(robot, tmp_path_factory.mktemp("casadi"), units=["plant"], backend="native", folded=True)["plant"]
    return traced_rate(robot), imported_rate(fmu)


def swing(folder: Path, version: str) -> Path:
    (folder / "swing.py").write_text(SWING, encoding="utf-8")
    return build_fmus(None, folder, units=[str(folder / "swing.py")], backend="native", fmi_version=version)["swing"]


def test_the_plant_and_its_jacobians_are_those_of_the_trace(rates):
    traced, imported = rates
    rng = np.random.default_rng(27)
    for _ in range(5):
        x, u = (rng.uniform(-0.9, 0.9, traced.size1_in(i)) for i in range(2))
        expected = traced(x, u).full()
        # the same operations, of which the compiler may join two, on numbers of up to 1e3
        np.testing.assert_allclose(imported(x, u).full(), expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        pairs = zip(imported.jacobian()(x, u, 0), traced.jacobian()(x, u, 0), strict=True)
        for actual, exact in pairs:
            assert actual.nnz() == exact.nnz()
            # directional derivatives add in another order than the columns of the trace
            np.testing.assert_allclose(actual.full(), exact.full(), rtol=0, atol=1e-13 * np.abs(exact.full()).max())


@pytest.mark.parametrize("version", ["2.0", pytest.param("3.0", marks=SEEN)])
def test_scalars_of_both_versions(tmp_path, version):
    """With FMI 3.0 there are adjoint derivatives."""
    options = {"uses_adjoint_derivatives": True} if version == "3.0" else {}
    imported = imported_rate(swing(tmp_path, version), **options)
    x, F, seed = np.array([0.4, -0.3]), 0.7, np.array([0.6, -1.1])
    value = [x[1], F * np.cos(x[0]) - 3.0 * x[0] ** 3 - np.tanh(x[1])]
    J = np.array([[0.0, 1.0], [-F * np.sin(x[0]) - 9.0 * x[0] ** 2, -1.0 / np.cosh(x[1]) ** 2]])
    # some roundings of numbers of order 1
    np.testing.assert_allclose(imported(x, F).full().ravel(), value, rtol=0, atol=1e-15)
    np.testing.assert_allclose(imported.jacobian()(x, F, 0)[0].full(), J, rtol=0, atol=1e-15)
    adjoint = imported.reverse(1)(x, F, 0, seed)
    np.testing.assert_allclose(adjoint[0].full().ravel(), seed @ J, rtol=0, atol=2e-15)
    assert float(adjoint[1]) == pytest.approx(seed[1] * np.cos(x[0]), abs=1e-15)
