"""Two masses that read each other, in FMUs that can do more than steps."""

from dataclasses import replace

from tests.engine.reference.models import Model, V

UPDATE = {"intermediateUpdate": "true"}
# A mass at a wall, with the spring and the damper to the other mass, whose position and speed it reads:
# m a = -k x - b v - c (x - x_o) - d (v - v_o).
MASS = Model(
    "Mass",
    [V("x", "output", start=0.0), V("v", "output", start=0.0), V("der(x)", needs=("v",)),
     V("der(v)", needs=("x", "v", "x_o", "v_o")),
     V("x_o", "input", start=0.0, more=UPDATE), V("v_o", "input", start=0.0, more=UPDATE),
     *(V(name, "parameter", start=1.0) for name in "mkbcd")],
    """
static void outputs(Instance *I)
{
    Data *p = &I->d;
    p->der_x = p->v;
    p->der_v = -(p->k * p->x + p->b * p->v + p->c * (p->x - p->x_o) + p->d * (p->v - p->v_o)) / p->m;
}
""",
    step=1e-3, states=("x", "v"), kinds=("CoSimulation",), second=True,
)  # fmt: skip
RATES = replace(MASS, name="Rates", simulation={"maxOutputDerivativeOrder": "1"},
                simulation_2={"maxOutputDerivativeOrder": "1"})  # fmt: skip
JACOBIAN = replace(MASS, name="Jacobian", simulation={"providesDirectionalDerivatives": "true"},
                   simulation_2={"providesDirectionalDerivative": "true"})  # fmt: skip
UPDATES = replace(MASS, name="Updates", step=1e-4, simulation={"providesIntermediateUpdate": "true"})
HELD = replace(MASS, name="Held", step=1e-4)
STRAIGHT = replace(UPDATES, name="Straight", step=1e-3)
WIRES = ["a.x -> b.x_o", "a.v -> b.v_o", "b.x -> a.x_o", "b.v -> a.v_o"]
