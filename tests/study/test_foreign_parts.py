"""FMUs of another tool as bodies, drive, plant and controller of a system; `models` has their C and descriptions.

Their solver is the explicit Euler method, so a recursion of a line has their numbers: a rounding of 1e-16 a step.
"""

import numpy as np
import pytest

import vdfmu
from tests.engine.reference import models
from tests.engine.reference.models import Model, V

JOINTS = (1, 2)
BODY = Model(
    "Body",
    [V("x", "output", start=0.0), V("v", "output", start=0.0), V("der(x)", needs=("v",)), V("der(v)", needs=("F",)),
     V("F", "input", start=0.0), V("m", "parameter", start=1.0)],
    "static void outputs(Instance *I) { I->d.der_x = I->d.v, I->d.der_v = I->d.F / I->d.m; }\n",
    step=1e-3, states=("x", "v"),
)  # fmt: skip
SPRING = Model(
    "Spring",
    [V("near", "input", start=0.0), V("far", "input", start=0.0), V("k", "parameter", start=1.0),
     V("pull", "output", needs=("near", "far", "k")), V("push", "output", needs=("near", "far", "k"))],
    """
static void outputs(Instance *I)
{
    I->d.pull = I->d.k * (I->d.far - I->d.near);
    I->d.push = -I->d.pull;
}
""",
    step=1e-3,
)  # fmt: skip
ARM = Model(
    "Arm",
    [*(V(f"{name}[{i}]", "output", start=0.0) for name in ("q", "q_dot") for i in JOINTS),
     *(V(f"der({name}[{i}])", needs=(of.format(i),)) for name, of in (("q", "q_dot[{}]"), ("q_dot", "tau[{}]"))
       for i in JOINTS),
     *(V(f"kappa_dot[{i}]", "output", needs=(f"q_dot[{i}]",)) for i in JOINTS),
     *(V(f"tau[{i}]", "input", start=0.0) for i in JOINTS)],
    "static void outputs(Instance *I)\n{\n"
    + "".join(f"    I->d.der_q_{i} = I->d.kappa_dot_{i} = I->d.q_dot_{i}, I->d.der_q_dot_{i} = I->d.tau_{i};\n"
              for i in JOINTS)
    + "}\n",
    step=1e-3, states=tuple(f"{name}[{i}]" for name in ("q", "q_dot") for i in JOINTS),
)  # fmt: skip
LAW = Model(
    "Law",
    [*(V(f"{name}[{i}]", "input", start=0.0) for name in ("q_d", "q") for i in JOINTS),
     V("k", "parameter", start=20.0),
     *(V(f"tau[{i}]", "output", needs=(f"q_d[{i}]", f"q[{i}]", "k")) for i in JOINTS)],
    "static void outputs(Instance *I)\n{\n"
    + "".join(f"    I->d.tau_{i} = I->d.k * (I->d.q_d_{i} - I->d.q_{i});\n" for i in JOINTS)
    + "}\n",
    step=1e-3,
)  # fmt: skip


@pytest.fixture(scope="module", name="fmu")
def _fmu(tmp_path_factory):
    """Return what builds an FMU of a model."""
    folder = tmp_path_factory.mktemp("foreign")
    return lambda model: models.build(model, "2.0", folder)


@pytest.mark.heavy
def test_an_arm(fmu):
    """It replaces the plant of a scenario; the rows are those of its equation, q'' = tau."""
    results = vdfmu.run("planar_tracking", units={"plant": fmu(ARM)}, stop=0.05, reference=False, out=False)
    q_dot, tau = results["plant.q_dot"], results["controller.tau"]
    assert np.abs(tau).max() > 1.0
    np.testing.assert_allclose(np.diff(q_dot, axis=0), 1e-3 * tau[1:], rtol=0.0, atol=1e-12)  # 5 rad/s, 1e-16 of it
    np.testing.assert_allclose(np.diff(results["plant.q"], axis=0), 1e-3 * q_dot[:-1], rtol=0.0, atol=1e-12)


def test_a_drive_between_motor_and_link(fmu):
    """Two masses of 1 kg on a spring of 50 N/m swing against each other."""
    body, ends = fmu(BODY), {"motor.x": "drive.near", "link.x": "drive.far"}
    system = vdfmu.connect(
        {"motor": body, "drive": fmu(SPRING), "link": body},
        {**ends, "drive.pull": "motor.F", "drive.push": "link.F"},
        stop=0.5, step=1e-3, parameters={"link.x": 0.1, "drive.k": 50.0},
    )  # fmt: skip
    results = system.run()
    apart, momentum = results["link.x"] - results["motor.x"], results["link.v"] + results["motor.v"]
    # w = sqrt(2 k / m) = 10 rad/s; Euler's method multiplies the swing by exp(h w^2 t / 2), to (h w)^2
    exact = 0.1 * np.cos(10.0 * results.time) * np.exp(50e-3 * results.time)
    np.testing.assert_allclose(apart, exact, rtol=0.0, atol=2.0 * 0.1 * 0.01**2)
    np.testing.assert_allclose(momentum, 0.0, atol=1e-14)


@pytest.mark.heavy
def test_a_controller(fmu):
    """It replaces the controller of a scenario."""
    results = vdfmu.run("planar_tracking", units={"controller": fmu(LAW)}, stop=0.05, reference=False, out=False)
    error = results["trajectory.q_d"] - results["plant.q"]
    assert np.abs(error).max() > 1e-4
    # it holds over a step what it computes from the signals at its begin
    np.testing.assert_allclose(results["controller.tau"][1:], 20.0 * error[:-1], rtol=0.0, atol=1e-15)
