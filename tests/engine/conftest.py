"""Small FMUs, made with pythonfmu, and packages of them."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from pythonfmu.builder import FmuBuilder

from tests.engine.reference import models
from vdfmu.engine.run import session

# Variables and dependencies come from SPEC. The body has do_step(), and calc(), which computes the outputs
# from the inputs in initialization mode.
TEMPLATE = """
import json
from xml.etree.ElementTree import Element, SubElement
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String
from pythonfmu.enums import Fmi2Status

SPEC = json.loads({spec!r})
NAMES = {{"_" + v["name"] for v in SPEC["variables"]}}
KINDS = dict(Real=Real, Integer=Integer, Boolean=Boolean, String=String)


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.initializing = True
        for v in SPEC["variables"]:
            setattr(self, "_" + v["name"], v["start"])
            variability = "continuous" if v["kind"] == "Real" else "discrete"
            if v["causality"].lower().endswith("parameter"):
                variability = "tunable"
            if v["name"] in SPEC["discrete"]:
                variability = "discrete"
            self.register_variable(KINDS[v["kind"]](
                v["name"], causality=Fmi2Causality[v["causality"]], variability=Fmi2Variability[variability],
                getter=lambda n="_" + v["name"]: self.read(n),
                setter=lambda x, n="_" + v["name"]: setattr(self, n, x)))

    def read(self, name):
        if self.initializing:
            self.calc()
        return getattr(self, name)

    def exit_initialization_mode(self):
        self.calc()
        self.initializing = False

    def _get_fmu_state(self):
        return {{k: v for k, v in self.__dict__.items() if k in NAMES or k in ("now", "initializing")}}

    def _set_fmu_state(self, state):
        self.__dict__.update(state)

    def to_xml(self, model_options=dict()):
        root = super().to_xml(model_options)
        units = Element("UnitDefinitions")
        for unit, base in SPEC["units"].items():
            SubElement(SubElement(units, "Unit", name=unit), "BaseUnit", base)
        if SPEC["units"]:
            root.insert(1, units)
        index = {{v["name"]: str(i + 1) for i, v in enumerate(SPEC["variables"])}}
        for v, element in zip(SPEC["variables"], root.find("ModelVariables")):
            if v.get("unit"):
                element[0].set("unit", v["unit"])
        if SPEC["dependencies"] is not None:
            structure = root.find("ModelStructure")
            initial = SubElement(structure, "InitialUnknowns")
            for unknown in structure.find("Outputs") if structure.find("Outputs") is not None else []:
                name = SPEC["variables"][int(unknown.get("index")) - 1]["name"]
                text = " ".join(index[n] for n in SPEC["dependencies"].get(name, []))
                unknown.set("dependencies", text)
                SubElement(initial, "Unknown", index=unknown.get("index"), dependencies=text)
            if len(initial) == 0:
                structure.remove(initial)
        return root

{body}
"""


def variable(name: str, causality: str, kind: str = "Real", start: object = 0.0, unit: str | None = None) -> dict:
    """Describe one variable of a test FMU."""
    return {"name": name, "causality": causality, "kind": kind, "start": start, "unit": unit}


def make_fmu(
    folder: Path,
    name: str,
    variables: list[dict],
    body: str,
    dependencies: Mapping[str, list[str]] | None,
    units: Mapping[str, Mapping[str, str]] | None = None,
    discrete: tuple[str, ...] = (),
) -> Path:
    """Build an FMU that saves its state; `dependencies` None: stock pythonfmu, without both."""
    spec = json.dumps(
        {
            "variables": variables,
            "dependencies": dependencies,
            "units": dict(units or {}),
            "discrete": discrete,
        }
    )
    code = "\n".join("    " + line if line else "" for line in body.strip("\n").splitlines())
    script = folder / f"vdfmu_test_{name.lower()}.py"
    script.write_text(TEMPLATE.format(name=name, spec=spec, body=code), encoding="utf-8")
    options = {"canGetAndSetFMUstate": True} if dependencies is not None else {}
    return Path(FmuBuilder.build_FMU(script, dest=folder / f"{name}.fmu", **options))


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """All test FMUs by name."""
    folder = tmp_path_factory.mktemp("fmus")
    step = "def do_step(self, t, h):\n    self.calc()\n    return True\n"
    built: dict[str, Path] = {}

    def add(name: str, *args, **kwargs) -> None:
        built[name] = make_fmu(folder, name, *args, **kwargs)

    gain = [variable("u", "input"), variable("y", "output"), variable("k", "parameter", start=2.0)]
    add("Gain", gain, "def calc(self):\n    self._y = self._k * self._u\n" + step, {"y": ["u"]})
    add("Stock", gain, "def calc(self):\n    self._y = self._k * self._u\n" + step, None)
    add(
        "Ramp",
        [variable("y", "output"), variable("slope", "parameter", start=1.0)],
        "now = 0.0\ndef setup_experiment(self, start, stop, tolerance):\n    self.now = start\n"
        "def calc(self):\n    self._y = self._slope * self.now\n"
        "def do_step(self, t, h):\n    self.now = t + h\n    self.calc()\n    return True\n",
        {},
    )
    add(
        "Plant",
        [variable("u", "input"), variable("y", "output"), variable("x0", "parameter", start=0.0),
         variable("load", "input")],
        "def calc(self):\n    self._y = self._x0\n"
        "def do_step(self, t, h):\n    self._y = self._y + h * (self._u + self._load)\n    return True\n",
        {},
    )  # fmt: skip
    add(
        "Adder",
        [variable("a", "input"), variable("b", "input"), variable("y", "output")],
        "def calc(self):\n    self._y = self._a + self._b\n" + step,
        {"y": ["a", "b"]},
    )
    add(
        "Crossed",  # two independent channels: no variable depends on itself when two are cross-connected
        [variable("a", "input"), variable("b", "input"), variable("y", "output"), variable("z", "output")],
        "def calc(self):\n    self._y = self._a + 1.0\n    self._z = self._b\n" + step,
        {"y": ["a"], "z": ["b"]},
    )
    add(
        "Mixed",  # y is a state, z passes u through
        [variable("u", "input"), variable("y", "output"), variable("z", "output")],
        "def calc(self):\n    self._z = self._u\n"
        "def do_step(self, t, h):\n    self._y = self._y + 1.0\n    self.calc()\n    return True\n",
        {"z": ["u"]},
    )
    add(
        "Logic",
        [variable("bi", "input", "Boolean", False), variable("ii", "input", "Integer", 0),
         variable("bo", "output", "Boolean", False), variable("io", "output", "Integer", 0)],
        "def calc(self):\n    self._bo = not self._bi\n    self._io = self._ii + 1\n" + step,
        {"bo": ["bi"], "io": ["ii"]},
    )  # fmt: skip
    add(
        "Loud",  # its libraries warn whoever programs with them
        [variable("y", "output")],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n    import numpy, warnings\n    numpy.log(numpy.zeros(1))\n"
        "    numpy.full(1, 1e300) * 1e300\n    warnings.warn('of the user')\n    self._y = t\n    return True\n",
        {},
    )
    add(
        "Derived",
        [
            variable("k", "parameter", start=1.0),
            variable("twice", "calculatedParameter"),
            variable("y", "output"),
        ],
        "def calc(self):\n    self._twice = 2 * self._k\n" + step,
        {},
    )
    add(
        "Counter",
        [variable("n", "output", "Integer", 0), variable("odd", "output", "Boolean", False),
         variable("word", "parameter", "String", "none"), variable("told", "output", "String", "")],
        "def calc(self):\n    self._told = self._word\n    self._odd = self._word == 'gr\u00fcn'\n"
        "def do_step(self, t, h):\n    self._n += 1\n    self._odd = self._n % 2 == 1\n    return True\n",
        {},
    )  # fmt: skip
    add(
        "Fragile",  # mode 0: exception, 1: returns False, 2: only warns, 3: exception in initialization mode
        [variable("y", "output"), variable("at", "parameter", start=1e9),
         variable("mode", "parameter", "Integer", 0)],
        "def calc(self):\n    pass\n"
        "def exit_initialization_mode(self):\n    self.initializing = False\n"
        "    if self._mode == 3:\n        raise ValueError('no start possible')\n"
        "def do_step(self, t, h):\n"
        "    if t >= self._at - 1e-9:\n"
        "        if self._mode == 0:\n            raise ValueError('q[3] is not finite: 100 %s')\n"
        "        self.log('the load is 50 %s of nominal', Fmi2Status.warning)\n"
        "        if self._mode == 1:\n            return False\n"
        "    self._y = t + h\n    return True\n",
        {},
    )  # fmt: skip
    add(
        "Choosy",  # a state that takes no step longer than h_max
        [variable("u", "input"), variable("y", "output"), variable("h_max", "parameter", start=0.1)],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n"
        "    self._y = self._y + h * self._u\n"
        "    if h > self._h_max:\n        self.log('the step is too long', Fmi2Status.warning)\n"
        "    return h <= self._h_max\n",
        {},
    )
    add(
        "Clock",  # a state, and the whole seconds that have passed; for short steps and for whole ones
        [variable("u", "input"), variable("y", "output"), variable("n", "output", "Integer", 0)],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n    self._y = self._y + h * (1.0 + self._u)\n"
        "    self._n = int(t + h + 1e-12)\n    return not 0.01 < h < 0.9\n",
        {},
    )
    add(
        "Reader",
        [variable("u", "input"), variable("i", "input", "Integer", 0), variable("y", "output"),
         variable("seen", "output", "Integer", 0)],
        "def calc(self):\n    self._y = -self._u\n    self._seen = self._i\n" + step,
        {"y": ["u"], "seen": ["i"]},
    )  # fmt: skip
    add(
        "Jump",
        [variable("y", "output")],
        "def calc(self):\n    pass\ndef do_step(self, t, h):\n    self._y = float(t + h >= 0.5)\n    return True\n",
        {},
        discrete=("y",),
    )
    add(
        "Talker",
        [variable("u", "input"), variable("y", "output", start=1.0)],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n    self.log('a step', Fmi2Status.warning)\n    self._y = self._y + h * self._u\n"
        "    return True\n",
        {},
    )
    add(
        "Refuser",
        [variable("n", "output", "Integer", 0)],
        "def calc(self):\n    pass\ndef do_step(self, t, h):\n    return h <= 0.1\n",
        {},
    )
    add(
        "Telling",  # x' = u, and its input
        [
            variable("u", "input"),
            variable("y", "output"),
            variable("told", "output"),
            variable("x0", "parameter"),
        ],
        "def calc(self):\n    self._y = self._x0\n    self._told = self._u\n"
        "def do_step(self, t, h):\n    self._y += h * self._u\n    self._told = self._u\n    return True\n",
        {"told": ["u"]},
    )
    add(
        "Late",  # a step that does not say that it is none
        [variable("y", "output"), variable("at", "parameter")],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n    self._y = float(t + h >= self._at)\n    return True\n",
        {},
    )
    add(
        "Lag",  # y' = u - y, exact for a constant input
        [variable("u", "input"), variable("y", "output")],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n"
        "    self._y = self._u + (self._y - self._u) * 2.718281828459045 ** -h\n    return True\n",
        {},
    )
    add(
        "Sprung",  # x'' = f = k (p - x), exact for a constant p
        [
            variable("p", "input"),
            variable("f", "output"),
            variable("x", "output"),
            variable("v", "output"),
            variable("k", "parameter", start=4.0),
        ],
        "def calc(self):\n    self._f = self._k * (self._p - self._x)\n"
        "def do_step(self, t, h):\n"
        "    from math import cos, sin, sqrt\n"
        "    a, v, w = self._x - self._p, self._v, sqrt(self._k)\n"
        "    self._x = self._p + a * cos(w * h) + v / w * sin(w * h)\n"
        "    self._v = v * cos(w * h) - w * a * sin(w * h)\n"
        "    self.calc()\n    return True\n",
        {"f": ["p"]},
    )
    add(
        "Carrier",  # p' = cos(t) - f / 4, exact for a constant f
        [variable("f", "input"), variable("p", "output")],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n"
        "    from math import sin\n"
        "    self._p += sin(t + h) - sin(t) - 0.25 * h * self._f\n    return True\n",
        {},
    )
    add(
        "Dividing",
        [variable("u", "input"), variable("y", "output")],
        "def calc(self):\n    self._y = 1.0 / self._u if self._u else float('inf')\n" + step,
        {"y": ["u"]},
    )
    add(
        "Speaker",
        [variable("word", "output", "String", "")],
        "def calc(self):\n    pass\ndef do_step(self, t, h):\n    self._word += '\u00fc'\n    return True\n",
        {},
    )
    add(
        "Echo",
        [variable("word", "input", "String", ""), variable("again", "output", "String", "")],
        "def calc(self):\n    self._again = self._word\n" + step,
        {"again": ["word"]},
    )
    add(
        "Listener",
        [variable("word", "input", "String", ""), variable("n", "output", "Integer", 0)],
        "def calc(self):\n    self._n = self._word.count('\u00fc')\n" + step,
        {"n": ["word"]},
    )
    wide = range(40)
    add(
        "Wide",  # says of no output that it depends on nothing
        [v for i in wide for v in (variable(f"u{i}", "input"), variable(f"y{i}", "output"))],
        "def calc(self):\n"
        "    for i in range(40):\n        setattr(self, f'_y{i}', float(i))\n"
        "def do_step(self, t, h):\n    return True\n",
        None,
    )
    add(
        "Digital",  # a discrete output for the input of the moment
        [variable("x", "input"), variable("u", "output"), variable("k", "parameter", start=1.0)],
        "def calc(self):\n    self._u = self._k * self._x\n" + step,
        {"u": ["x"]},
        discrete=("u",),
    )
    add(
        "Relay",
        [variable("u", "input"), variable("up", "output", "Boolean", True)],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n"
        "    self._up = self._u < -0.1 or (self._up and self._u <= 0.1)\n    return True\n",
        {"up": ["u"]},
    )
    for motor, dependencies in (("Motor", {}), ("DirectMotor", {"y": ["up"]})):  # the second says too much
        add(
            motor,
            [variable("up", "input", "Boolean", True), variable("y", "output")],
            "def calc(self):\n    pass\n"
            "def do_step(self, t, h):\n    self._y += h * (1.0 if self._up else -1.0)\n    return True\n",
            dependencies,
        )
    add(
        "Array",
        [variable("k[1]", "parameter"), variable("k[2]", "parameter"), variable("y", "output")],
        "def calc(self):\n    self._y = 10.0 * getattr(self, '_k[1]') + getattr(self, '_k[2]')\n" + step,
        {},
    )
    add(
        "Degrees",
        [variable("y", "output", start=0.0, unit="deg"), variable("mm", "output", start=0.0, unit="mm"),
         variable("degC", "output", start=0.0, unit="degC")],
        "def calc(self):\n    pass\n"
        "def do_step(self, t, h):\n    self._y += 90.0\n    self._mm += 1500.0\n    self._degC += 10.0\n"
        "    return True\n",
        {},
        units={
            "deg": {"rad": "1", "factor": "0.017453292519943295"},
            "mm": {"m": "1", "factor": "0.001"},
            "degC": {"K": "1", "offset": "273.15"},
        },
    )  # fmt: skip
    add(
        "Radians",
        [variable("u", "input", unit="rad"), variable("m", "input", unit="m"),
         variable("K", "input", unit="K"),
         variable("width", "parameter", start=1.0, unit="m"), variable("y", "output", unit="m")],
        "def calc(self):\n    self._y = self._width\ndef do_step(self, t, h):\n    return True\n",
        {},
        units={"rad": {"rad": "1"}, "m": {"m": "1"}, "K": {"K": "1"}},
    )  # fmt: skip
    return built


SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
  xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
  xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
  xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping" version="1.0" name="test">
  <ssd:System name="root">{connectors}{bindings}
  <ssd:Elements>{elements}</ssd:Elements>{connections}</ssd:System>
  {units}{experiment}
</ssd:SystemStructureDescription>"""


def component(name: str, fmu: str, connectors: str = "", bindings: str = "", attributes: str = "") -> str:
    """Return the XML of a component; `connectors` as in "u:input y:output:Real:rad"."""
    return (
        f'<ssd:Component name="{name}" source="resources/{fmu}.fmu" {attributes}>'
        f"{connector_list(connectors)}{bindings}</ssd:Component>"
    )


def connector_list(connectors: str) -> str:
    items = []
    for text in connectors.split():
        name, kind, *rest = text.split(":")
        unit = f' unit="{rest[1]}"' if len(rest) > 1 else ""
        inner = f"<ssc:{rest[0]}{unit}/>" if rest else ""
        items.append(f'<ssd:Connector name="{name}" kind="{kind}">{inner}</ssd:Connector>')
    return f"<ssd:Connectors>{''.join(items)}</ssd:Connectors>" if items else ""


def connection(text: str, inner: str = "", attributes: str = "") -> str:
    """Return the XML of "a.y -> b.u"; an end without a dot is a connector of the system."""
    ends = []
    for label, end in zip(("start", "end"), text.split(" -> "), strict=True):
        element, _, name = end.rpartition(".")
        ends.append((f'{label}Element="{element}" ' if element else "") + f'{label}Connector="{name}"')
    return f"<ssd:Connection {' '.join(ends)} {attributes}>{inner}</ssd:Connection>"


def values(inner: str, mapping: str = "", attributes: str = "") -> str:
    """Return a binding with inline values."""
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {attributes}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="1.0" name="set"><ssv:Parameters>{inner}</ssv:Parameters>'
        f"</ssv:ParameterSet></ssd:ParameterValues>{mapping}</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def integer(name: str, value: int) -> str:
    return f'<ssv:Parameter name="{name}"><ssv:Integer value="{value}"/></ssv:Parameter>'


def real(name: str, value: float, unit: str = "") -> str:
    unit = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value}"{unit}/></ssv:Parameter>'


IN_PROCESS = {
    "test_algorithms", "test_clocks", "test_continuous", "test_derivatives", "test_events", "test_experiment",
    "test_fmi3", "test_inputs", "test_loops", "test_model_exchange", "test_multirate", "test_observer", "test_picture",
    "test_recorder", "test_reference_models", "test_simulator", "test_systems",
}  # fmt: skip
"""Tests of signals and steps, which are the same in this process and in one of their own, except for its start."""


@pytest.fixture(autouse=True)
def in_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run components in this process where nothing is said of isolation, for the tests of `IN_PROCESS`."""
    if request.module.__name__.rpartition(".")[2] in IN_PROCESS:
        plain = session.unpack_units
        monkeypatch.setattr(session, "unpack_units", lambda checked, folder: (plain(checked, folder)[0], False))


@pytest.fixture
def pack(tmp_path: Path, fmus: dict[str, Path]) -> Callable[..., Path]:
    """Return a function that packs an SSP of elements and connections."""

    def write(
        elements: list[str],
        connections: list[str] | tuple[()] = (),
        *,
        connectors: str = "",
        bindings: str = "",
        units: str = "",
        dictionaries: str = "",
        extra: Mapping[str, str | bytes] | None = None,
        experiment: str = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>',
        name: str = "test.ssp",
    ) -> Path:
        items = [c if c.startswith("<") else connection(c) for c in connections]
        text = SSD.format(
            connectors=connector_list(connectors),
            bindings=bindings,
            elements="".join(elements),
            connections=(f"<ssd:Connections>{''.join(items)}</ssd:Connections>" if items else "") + dictionaries,
            units=f"<ssd:Units>{units}</ssd:Units>" if units else "",
            experiment=experiment,
        )
        path = tmp_path / name
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("SystemStructure.ssd", text)
            for fmu, source in fmus.items():
                if f"resources/{fmu}.fmu" in text:
                    archive.write(source, f"resources/{fmu}.fmu")
            for member, content in (extra or {}).items():
                archive.writestr(member, content)
        return path

    return write


class Xml:
    """The helpers above as one fixture, since test modules cannot import a conftest."""

    component = staticmethod(component)
    connection = staticmethod(connection)
    values = staticmethod(values)
    real = staticmethod(real)
    integer = staticmethod(integer)


@pytest.fixture(scope="session")
def xml() -> type[Xml]:
    return Xml


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Return the function ``built(model, version)``, the bytes of the FMU of a model."""
    folder, known = tmp_path_factory.mktemp("reference"), {}

    def once(model: models.Model, version: str = "3.0") -> bytes:
        key = model.name, version
        if key not in known:
            known[key] = models.build(model, version, folder).read_bytes()
        return known[key]

    return once


@pytest.fixture
def system(pack, xml, built):
    """Return a function that packs a system: {component: (model, version)}, connections and values of parameters."""

    def write(components, connections=(), bindings: dict[str, str] | None = None) -> Path:
        elements, extra = [], {}
        used = [end.partition(".")[::2] for c in connections for end in c.split(" -> ")]
        for name, (model, version) in components.items():
            fmu = f"{model.name}_{version[0]}"
            kinds = {v.name: v.causality for v in model.variables}
            ports = dict.fromkeys(port for owner, port in used if owner == name)
            text = " ".join(f"{port}:{kinds[port.partition('[')[0]]}" for port in ports)
            elements.append(xml.component(name, fmu, text, (bindings or {}).get(name, "")))
            extra[f"resources/{fmu}.fmu"] = built(model, version)
        return pack(elements, connections, extra=extra)

    return write
