"""Models after the Reference FMUs of the Modelica Association, and others, as FMUs of FMI 2.0 and 3.0.

Each is described once here; the model description and the C file beside `layer.c` are made of that.
"""

import re
import subprocess
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import fmpy

from tests.cc import CC

HERE = Path(__file__).parent
HEADERS = Path(fmpy.__file__).parent / "c-code"
INTEGERS = tuple(f"{sign}Int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "U"))
C_TYPES = {"Float64": "double", "Float32": "float", "Boolean": "bool", "Enumeration": "int64_t", "String": "Text",
           "Binary": "Text", "Clock": "struct { bool tick; double interval; }",
           **{name: f"{name.lower()}_t" for name in INTEGERS}}  # fmt: skip
TYPES_2 = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}


class V(NamedTuple):
    """A variable: `dims` numbers or names of structural parameters, `room` what an array of these may need."""

    name: str
    causality: str = "local"
    type: str = "Float64"
    start: Any = None
    variability: str | None = None
    dims: tuple[int | str, ...] = ()
    room: int = 0
    more: dict[str, str] = {}
    needs: tuple[str, ...] | None = ()

    @property
    def field(self) -> str:
        """Its name in C."""
        return re.sub(r"\W", "_", self.name.replace(")", "").replace("]", ""))


@dataclass
class Model:
    """A model: `states` with as many derivatives ``der(x)``, its C and what else the descriptions say."""

    name: str
    variables: list[V]
    code: str
    step: float = 1e-3
    states: tuple[str, ...] = ()
    indicators: int = 0
    sizes: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("CoSimulation", "ModelExchange")
    simulation: dict[str, str] = field(default_factory=dict)
    items: tuple[str, ...] = ()
    second: bool = False
    simulation_2: dict[str, str] = field(default_factory=dict)

    def reference(self, name: str) -> int:
        """Return the value reference, and index from 1, of a variable."""
        return 1 + [v.name for v in self.variables].index(name)

    def causalities(self, version: str) -> dict[str, str]:
        """Return the causality of each variable."""
        return {v.name: v.causality for v in self.variables}


def initial(v: V) -> str:
    if v.type in ("String", "Binary"):
        content = (v.start or "").encode() if v.type == "String" else bytes.fromhex(v.start or "")
        return f"{{{len(content)}, {{{', '.join(str(b) for b in content) or '0'}}}}}"
    if v.type == "Clock":
        return "{false, NAN}"
    start = v.start if isinstance(v.start, (list, tuple)) else [v.start or 0]
    text = ", ".join(str(x).lower() if isinstance(x, bool) else f"{x}" for x in start)
    return f"{{{text}}}" if v.dims else text


EMPTY = {
    "begin": "Instance *I) { (void)I; }", "outputs": "Instance *I) { (void)I; }", "event": "Instance *I) { (void)I; }",
    "indicators": "Instance *I, double *z) { (void)I, (void)z; }",
}  # fmt: skip
"""Functions of a model that need not do anything."""


def c_files(model: Model) -> dict[str, str]:
    ordered = [v for s in model.states for v in model.variables if v.name == s]
    ordered += [v for s in model.states for v in model.variables if v.name == f"der({s})"]
    ordered += [v for v in model.variables if v not in ordered]
    fields = "".join(f"    {C_TYPES[v.type]} {v.field}{f'[{v.room}]' if v.dims else ''};\n" for v in ordered)
    sizes = [v.field for v in model.variables if v.name in model.sizes]
    rows = []
    for v in model.variables:
        sides = [d if isinstance(d, int) else -1 - model.sizes.index(d) for d in v.dims] + [0, 0]
        kind = "INT64" if v.type == "Enumeration" else v.type.upper()
        rows.append(f"    {{{model.reference(v.name)}, {kind}, offsetof(Data, {v.field}), {sides[0]}, {sides[1]}}},\n")
    x = next((v.field for v in model.variables if v.name in model.states), None)
    states, rates = (f"((double *)&(I)->d.{p}{x})" if x else "((double *)NULL)" for p in ("", "der_"))
    array = bool(x and next(v for v in model.variables if v.name in model.states).dims)
    nx = f"(int)(I)->d.{model.sizes[0]}" if array else len(model.states)
    values = "".join(f"    .{v.field} = {initial(v)},\n" for v in model.variables)
    missing = [name for name in EMPTY if f"static void {name}(" not in model.code]
    empty = "".join(f"static void {name}({EMPTY[name]}\n" for name in missing)
    return {
        "model.h": f"typedef struct {{\n{fields}}} Data;\n#define STEP {model.step!r}\n"
        f"#define SECOND {int(model.second)}\n#define NX(I) ({nx})\n"
        f"#define NZ {model.indicators}\n#define STATES(I) {states}\n#define RATES(I) {rates}\n"
        f"#define SIZES(I) ((const uint64_t *)(const void *)&(I)->d.{(sizes or [ordered[0].field])[0]})\n",
        "model.c": f"static const Data initial = {{\n{values}}};\n"
        f"static const Variable table[] = {{\n{''.join(rows)}}};\n{empty}{model.code}",
    }  # fmt: skip


def description_3(model: Model) -> Element:
    root = Element("fmiModelDescription", fmiVersion="3.0", modelName=model.name, instantiationToken="{own}")
    common = {"modelIdentifier": model.name, "canGetAndSetFMUState": "true"}
    if "ModelExchange" in model.kinds:
        SubElement(root, "ModelExchange", common)
    if "CoSimulation" in model.kinds:
        more = {"canHandleVariableCommunicationStepSize": "true"} | model.simulation
        SubElement(root, "CoSimulation", common | more)
    if model.items:
        options = SubElement(SubElement(root, "TypeDefinitions"), "EnumerationType", name="Option")
        for k, item in enumerate(model.items):
            SubElement(options, "Item", name=item, value=str(k + 1))
    variables = SubElement(root, "ModelVariables")
    SubElement(variables, "Float64", name="time", valueReference="0", causality="independent", variability="continuous")
    for v in model.variables:
        attributes = {"name": v.name, "valueReference": str(model.reference(v.name)), "causality": v.causality}
        attributes |= {"variability": v.variability} if v.variability else {}
        attributes |= {"declaredType": "Option"} if v.type == "Enumeration" else {}
        starts = v.start if isinstance(v.start, (list, tuple)) else [v.start]
        text = " ".join(str(x).lower() if isinstance(x, bool) else str(x) for x in starts)
        if v.start is not None and v.causality in ("output", "local"):
            attributes["initial"] = "exact"
        if v.start is not None and v.type not in ("String", "Binary"):
            attributes["start"] = text
        if v.name.startswith("der("):
            attributes["derivative"] = str(model.reference(v.name[4:-1]))
        attributes |= {k: " ".join(str(model.reference(n)) for n in x.split()) if k == "clocks" else x
                       for k, x in v.more.items() if k != "indicator"}  # fmt: skip
        element = SubElement(variables, v.type, attributes)
        for d in v.dims:
            size = {"start": str(d)} if isinstance(d, int) else {"valueReference": str(model.reference(d))}
            SubElement(element, "Dimension", size)
        if v.start is not None and v.type in ("String", "Binary"):
            SubElement(element, "Start", value=v.start)
    structure = SubElement(root, "ModelStructure")
    outputs = [v for v in model.variables if v.causality == "output"]
    rates = [v for v in model.variables if v.name.startswith("der(")]
    states = [v for v in model.variables if v.name in model.states]
    for tag, unknowns in (
        ("Output", outputs),
        ("ContinuousStateDerivative", rates),
        (
            "InitialUnknown",
            [
                v
                for v in (*outputs, *states, *rates)
                if v.start is None and v.type != "Clock" and "clocks" not in v.more
            ],
        ),
    ):
        for v in unknowns:
            needs = {} if v.needs is None else {"dependencies": " ".join(str(model.reference(n)) for n in v.needs)}
            SubElement(structure, tag, {"valueReference": str(model.reference(v.name))} | needs)
    for v in model.variables:
        if v.more.get("indicator"):
            SubElement(structure, "EventIndicator", valueReference=str(model.reference(v.name)))
    return root


def description_2(model: Model) -> Element:
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName=model.name, guid="{own}",
                   numberOfEventIndicators=str(model.indicators))  # fmt: skip
    common = {"modelIdentifier": model.name, "canGetAndSetFMUstate": "true"}
    if "ModelExchange" in model.kinds:
        SubElement(root, "ModelExchange", common)
    if "CoSimulation" in model.kinds:
        more = {"canHandleVariableCommunicationStepSize": "true"} | model.simulation_2
        SubElement(root, "CoSimulation", common | more)
    variables = SubElement(root, "ModelVariables")
    for v in model.variables:
        attributes = {"name": v.name, "valueReference": str(model.reference(v.name)), "causality": v.causality}
        kind = TYPES_2[v.type]
        variability = v.variability or ("fixed" if "arameter" in v.causality else None)
        variability = variability or ("continuous" if kind == "Real" else "discrete")
        attributes["variability"] = variability
        if v.start is not None and v.causality in ("output", "local"):
            attributes["initial"] = "exact"
        typed: dict[str, str] = {} if v.start is None else {"start": str(v.start).lower()}
        if v.name.startswith("der("):
            typed["derivative"] = str(model.reference(v.name[4:-1]))
        SubElement(SubElement(variables, "ScalarVariable", attributes), kind, typed)
    structure = SubElement(root, "ModelStructure")
    outputs = [v for v in model.variables if v.causality == "output"]
    rates = [v for v in model.variables if v.name.startswith("der(")]
    for tag, unknowns in (
        ("Outputs", outputs),
        ("Derivatives", rates),
        ("InitialUnknowns", [v for v in (*outputs, *rates) if v.start is None]),
    ):
        parent = SubElement(structure, tag) if unknowns else None
        for v in unknowns:
            needs = "" if v.needs is None else " ".join(str(model.reference(n)) for n in v.needs)
            SubElement(parent, "Unknown", index=str(model.reference(v.name)), dependencies=needs)  # type: ignore[arg-type]
    return root


def build(model: Model, version: str, folder: Path) -> Path:
    work = folder / f"{model.name}_{version}_sources"
    work.mkdir(parents=True, exist_ok=True)
    for name, text in c_files(model).items():
        (work / name).write_text(text)
    library = work / f"{model.name}{fmpy.sharedLibraryExtension}"
    flags = ["-std=c11", "-D_DEFAULT_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function",
             "-Wno-nonnull", "-shared", "-fPIC",
             "-ffp-contract=off", f"-DFMI={version[0]}", f"-I{HEADERS}", f"-I{work}"]  # fmt: skip
    sources = [HERE / "layer.c", HERE / "stubs.c"]
    subprocess.run([*CC, *flags, "-o", library, *sources, "-lm"], check=True)
    root = description_2(model) if version == "2.0" else description_3(model)
    platform = fmpy.platform if version == "2.0" else fmpy.platform_tuple
    path = folder / f"{model.name}_{version[0]}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", tostring(root, encoding="utf-8", xml_declaration=True))
        archive.write(library, f"binaries/{platform}/{library.name}")
    return path


DAHLQUIST = Model(
    "Dahlquist",
    [V("x", "output", start=1.0), V("der(x)", needs=("x",)), V("k", "parameter", start=1.0, variability="fixed")],
    "static void outputs(Instance *I) { I->d.der_x = -I->d.k * I->d.x; }\n",
    step=0.1, states=("x",),
)  # fmt: skip
SCALARS = {"Float64": 0.0, "Float32": 0.0, **dict.fromkeys(INTEGERS, 0), "Boolean": False, "String": "Set me!",
           "Binary": "666f6f", "Enumeration": 1}  # fmt: skip


def feedthrough(types: tuple[str, ...], suffix: str = "", simulation: dict[str, str] | None = None) -> Model:
    variables = [V("k", "parameter", "Float64", 1.0, "fixed")]
    for kind in types:
        variables.append(V(f"{kind}_input", "input", kind, SCALARS[kind]))
        variables.append(V(f"{kind}_output", "output", kind, needs=(f"{kind}_input",)))
    copies = "".join(f"    I->d.{kind}_output = I->d.{kind}_input;\n" for kind in types)
    return Model(
        f"Feedthrough{suffix}", variables, f"static void outputs(Instance *I)\n{{\n{copies}}}\n", step=0.1,
        items=("Option 1", "Option 2"), simulation=simulation or {},
    )  # fmt: skip


FEEDTHROUGH = feedthrough(tuple(SCALARS))
FEEDTHROUGH_2 = feedthrough(("Float64", "Int32", "Boolean", "String"), "2")
EYE = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
STATE_SPACE = Model(
    "StateSpace",
    [V("n", "structuralParameter", "UInt64", 3, "fixed"), V("m", "structuralParameter", "UInt64", 3, "fixed"),
     V("r", "structuralParameter", "UInt64", 3, "fixed"),
     V("A", "parameter", start=EYE, dims=("n", "n"), room=25, variability="tunable"),
     V("B", "parameter", start=EYE, dims=("n", "m"), room=25, variability="tunable"),
     V("C", "parameter", start=EYE, dims=("r", "n"), room=25, variability="tunable"),
     V("D", "parameter", start=EYE, dims=("r", "m"), room=25, variability="tunable"),
     V("x0", "parameter", start=[0.0] * 3, dims=("n",), room=5, variability="tunable"),
     V("u", "input", start=[1.0, 2.0, 3.0], dims=("m",), room=5),
     V("x", dims=("n",), room=5, needs=("x0",)), V("der(x)", dims=("n",), room=5, needs=None),
     V("y", "output", dims=("r",), room=5, needs=None)],
    """
static void begin(Instance *I) { memcpy(I->d.x, I->d.x0, sizeof I->d.x); }
static void times(const double *A, const double *B, const double *x, const double *u, double *y, size_t r,
                  size_t n, size_t m)
{
    for (size_t i = 0; i < r; i++) {
        y[i] = 0;
        for (size_t j = 0; j < n; j++)
            y[i] += A[i * n + j] * x[j];
        for (size_t j = 0; j < m; j++)
            y[i] += B[i * m + j] * u[j];
    }
}
static void outputs(Instance *I)
{
    Data *d = &I->d;
    times(d->A, d->B, d->x, d->u, d->der_x, d->n, d->n, d->m);
    times(d->C, d->D, d->x, d->u, d->y, d->r, d->n, d->m);
}
""",
    step=1e-3, states=("x",), sizes=("n", "m", "r"),
)  # fmt: skip
PERIODIC = {"intervalVariability": "constant", "intervalDecimal": "0.1"}
TRIGGERED = {"intervalVariability": "triggered"}
EVENTS = {"hasEventMode": "true"}
CONTROLLER = Model(
    "SampledController",
    [V("r", "input", "Clock", more=PERIODIC), V("e", "input", start=0.0, variability="discrete", more={"clocks": "r"}),
     V("u", "output", variability="discrete", more={"clocks": "r"}, needs=("e",)),
     V("i", "local", start=0.0, variability="discrete"),
     V("k_p", "parameter", start=2.0), V("k_i", "parameter", start=3.0), V("w", "parameter", start=1.0)],
    """
static void outputs(Instance *I)
{
    Data *d = &I->d;
    if (d->r.tick)
        d->u = d->k_p * (d->w - d->e) + d->i;
}
static void event(Instance *I)
{
    Data *d = &I->d;
    outputs(I);
    if (d->r.tick)
        d->i += 0.1 * d->k_i * (d->w - d->e);
    d->r.tick = false;
}
""",
    kinds=("CoSimulation",), simulation=EVENTS,
)  # fmt: skip
LAG = Model(
    "Lag",
    [V("x", "output", start=0.0), V("der(x)", needs=("x", "u")), V("u", "input", start=0.0)],
    "static void outputs(Instance *I) { I->d.der_x = I->d.u - I->d.x; }\n",
    step=1e-2, states=("x",),
)  # fmt: skip
CLOCKS = Model(
    "Clocks",
    [V("inClock1", "input", "Clock", more={"intervalVariability": "constant", "intervalDecimal": "1.0"}),
     V("inClock3", "input", "Clock", more={"intervalVariability": "countdown"}),
     V("outClock", "output", "Clock", more=TRIGGERED),
     V("inClock1Ticks", "output", "Int32", 0), V("inClock3Ticks", "output", "Int32", 0),
     V("totalInClockTicks", "output", "Int32", 0), V("delay", "parameter", start=0.0)],
    """
static void outputs(Instance *I)
{
    const int ticks = I->d.inClock1.tick + I->d.inClock3.tick;
    I->d.outClock.tick = ticks && (I->d.totalInClockTicks + ticks) % 5 == 0;
}
static void event(Instance *I)
{
    Data *d = &I->d;
    d->inClock1Ticks += d->inClock1.tick;
    d->inClock3Ticks += d->inClock3.tick;
    d->totalInClockTicks += d->inClock1.tick + d->inClock3.tick;
    if (d->inClock1.tick && d->inClock1Ticks == 5) /* at 4 s */
        d->inClock3.interval = d->delay;
    d->inClock1.tick = d->inClock3.tick = d->outClock.tick = false;
}
""",
    step=0.1, kinds=("CoSimulation",), simulation=EVENTS,
)  # fmt: skip
COUNTER = Model(
    "Counter",
    [V("c", "input", "Clock", more=TRIGGERED), V("n", "output", "Int32", 0, more={"clocks": "c"})],
    """
static void outputs(Instance *I)
{
    if (I->d.c.tick)
        I->d.n++;
    I->d.c.tick = false;
}
static void event(Instance *I) { outputs(I); }
""",
    step=0.1, kinds=("CoSimulation",), simulation=EVENTS,
)  # fmt: skip
