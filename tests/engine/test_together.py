"""Components of model exchange that depend on each other within a step: the master integrates them as one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from tests.engine.reference.models import Model, V
from tests.engine.reference_fmus import STAIR
from vdfmu.base.errors import CosimError, SspError, UsageError
from vdfmu.engine.run import simulate

PIECE = Model(
    "Piece",
    [
        V("x", "output", start=1.0), V("der(x)", needs=("x", "f")), V("s", "input", start=0.0),
        V("f", "input", start=0.0), V("s_out", "output", needs=("s", "x")), V("r", "output", needs=("f", "x", "s")),
    ],
    "static void outputs(Instance *I)\n{\n"
    "    I->d.s_out = I->d.s + I->d.x;\n    I->d.r = I->d.f - I->d.x - I->d.s;\n    I->d.der_x = I->d.f - I->d.x;\n}\n",
    step=1e-2, states=("x",), kinds=("ModelExchange",),
)  # fmt: skip
CHAIN = ["a.s_out -> b.s", "b.s_out -> c.s", "c.r -> b.f", "b.r -> a.f"]
"""A chain: s goes one way, r comes back; no variable depends on itself."""


def chain(version):
    return {name: (PIECE, version) for name in "bca"}


@pytest.mark.few(2)
@pytest.mark.parametrize("isolate", [False, True])
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_chain_is_integrated_as_one(system, version, isolate):
    options = {"stop": 2.0, "step": 0.5, "tolerance": 1e-10, "isolate": isolate, "record": ["*"]}
    results = simulate(system(chain(version), CHAIN), **options)
    # by hand: s_a = 0, s_b = x_a, s_c = x_a + x_b; f_c = 0, f_b = r_c = -x_c - s_c, f_a = r_b = f_b - x_b - s_b
    A = np.array([[-1.0 - 2.0, -2.0, -1.0], [-1.0, -1.0 - 1.0, -1.0], [0.0, 0.0, -1.0]])
    exact = np.array([expm(A * t) @ np.ones(3) for t in results.time])
    for i, name in enumerate("abc"):
        # local errors of 1e-10 in some 20 steps of a system that decays
        np.testing.assert_allclose(results[f"{name}.x"], exact[:, i], rtol=0, atol=2e-9)
    # what members read is of the same row as what they give
    np.testing.assert_array_equal(results["c.s"], results["b.s_out"])
    np.testing.assert_array_equal(results["b.f"], results["c.r"])
    np.testing.assert_allclose(results["c.s"], results["a.x"] + results["b.x"], rtol=0, atol=1e-15)


def test_events_of_co_simulation_beside_them_are_refused(system):
    with pytest.raises(UsageError, match="b, c, a: depend on each other within a step and are integrated together"):
        simulate(system(chain("2.0") | {"events": (STAIR, "3.0")}, CHAIN), stop=1.0, step=0.5, isolate=False)


RELAY = Model(
    "Relay",
    [
        V("x", "output", start=0.0), V("der(x)"), V("u", "input", start=0.0), V("f", "input", start=0.0),
        V("y", "output", start=0.0, needs=("u",)), V("r", "output", start=0.0, needs=("f", "u")),
        V("at", "parameter", start=1e9), V("up", start=0.0), V("on", "output", "Boolean", False, "discrete"),
        V("go", "input", "Boolean", False, "discrete"),
    ],
    "static void begin(Instance *I) { I->next = I->d.at; }\n"
    "static void outputs(Instance *I)\n{\n"
    "    I->d.y = I->d.up;\n    I->d.r = I->d.f + I->d.x + 0 * I->d.u;\n    I->d.der_x = I->d.up;\n}\n"
    "static void event(Instance *I)\n{\n"
    "    if (I->time + 1e-9 >= I->d.at || I->d.u > 0.5)\n        I->d.up = 1;\n    I->next = INFINITY;\n"
    "    I->d.at = I->d.up ? 1e9 : I->d.at;\n    I->next = I->d.at;\n}\n",
    step=1e-2, states=("x",), kinds=("ModelExchange",),
)  # fmt: skip
WIRES = ["a.y -> b.u", "b.y -> c.u", "c.r -> b.f", "b.r -> a.f"]


@pytest.mark.few(1)
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_event_passes_through_all_at_its_time(system, xml, version):
    """The first switches at 0.75 s, within a step, and the others by it; x is the time since."""
    path = system({name: (RELAY, version) for name in "bca"}, WIRES, {"a": xml.values(xml.real("at", 0.75))})
    results = simulate(path, stop=2.0, step=0.5)
    for name in "abc":
        # a constant rate is integrated without error, but for the rounding of times
        np.testing.assert_allclose(results[f"{name}.x"], np.maximum(results.time - 0.75, 0.0), rtol=0, atol=1e-8)


def test_an_event_that_does_not_settle_and_values_that_are_no_reals_are_refused(system, xml):
    """Each of two counts on with what the other has counted."""
    code = RELAY.code.replace("        I->d.up = 1;", "        I->d.up = 1 + I->d.u + I->d.f;").replace(
        "I->d.r = I->d.f + I->d.x + 0 * I->d.u;", "I->d.r = I->d.up;")  # fmt: skip
    restless = replace(RELAY, name="Restless", code=code)
    path = system({name: (restless, "2.0") for name in "bca"}, WIRES, {"a": xml.values(xml.real("at", 0.75))})
    with pytest.raises(CosimError, match="an event does not settle: values between b, c, a still change"):
        simulate(path, stop=2.0, step=0.5, isolate=False)
    path = system({name: (RELAY, "2.0") for name in "bca"}, [*WIRES, "a.on -> b.go"])
    with pytest.raises(
        SspError, match=r"a\.on -> b\.go: is of type Boolean, but must be real, because b, c, a depend on"
    ):
        simulate(path, stop=1.0, step=0.5, isolate=False)
