"""Small FMUs, made with pythonfmu, and packages of them."""

import json
import zipfile
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from textwrap import indent

import pytest
from pythonfmu.builder import FmuBuilder

from tests.engine import texts
from tests.engine.files import hard_results
from tests.engine.reference import models
from tests.engine.reference_fmus import Reference
from tests.engine.texts import connection, connector_list
from tests.wild import write_strict
from vdfmu.engine.run import Results, simulator
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import load_scenario

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


_READ = {"Real": float, "Integer": int, "Boolean": "True".__eq__, "String": str}
_START = {"Real": "0", "Integer": "0", "Boolean": "False", "String": ""}


def variable(text: str) -> dict:
    """Return a variable of a test FMU from ``name:causality[:kind[:start[:unit]]]``."""
    name, causality, kind, start, unit = (text.split(":") + 5 * [""])[:5]
    kind = kind or "Real"
    start = _READ[kind](start or _START[kind])
    return {"name": name, "causality": causality, "kind": kind, "start": start, "unit": unit or None}


def make_fmu(
    folder: Path, name: str, variables: str, step: str = "self.calc()", calc: str = "pass", depends: str | None = "",
    more: str = "", units: Mapping[str, Mapping[str, str]] | None = None, discrete: tuple[str, ...] = (),
) -> Path:  # fmt: skip
    """Build an FMU that saves its state, from the code of its step and of its outputs in initialization mode."""
    # `depends`: "y:u,v z:u" for outputs that depend on inputs; None: stock pythonfmu, without that and without states.
    dependencies = None if depends is None else {y: u.split(",") for y, u in (t.split(":") for t in depends.split())}
    listed = [variable(text) for text in variables.split()]
    spec = {"variables": listed, "dependencies": dependencies, "units": dict(units or {}), "discrete": discrete}
    code = f"{more}def calc(self):\n{indent(calc, '    ')}\n"
    code += f"def do_step(self, t, h):\n{indent(step, '    ')}\n    return True\n"
    script = folder / f"vdfmu_test_{name.lower()}.py"
    text = TEMPLATE.format(name=name, spec=json.dumps(spec), body=indent(code, "    "))
    script.write_text(text, encoding="utf-8")
    options = {"canGetAndSetFMUstate": True} if depends is not None else {}
    return Path(FmuBuilder.build_FMU(script, dest=folder / f"{name}.fmu", **options))


@pytest.fixture(scope="session")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    built: dict[str, Path] = {}

    def add(name: str, *args, **kwargs) -> None:
        built[name] = make_fmu(folder, name, *args, **kwargs)

    gain = "u:input y:output k:parameter:Real:2"
    add("Gain", gain, calc="self._y = self._k * self._u", depends="y:u")
    add("Stock", gain, calc="self._y = self._k * self._u", depends=None)
    add(
        "Ramp", "y:output slope:parameter:Real:1", "self.now = t + h\nself.calc()", "self._y = self._slope * self.now",
        more="now = 0.0\ndef setup_experiment(self, start, stop, tolerance):\n    self.now = start\n",
    )  # fmt: skip
    euler = "self._y = self._y + h * (self._u + self._load)"
    add("Plant", "u:input y:output x0:parameter load:input", euler, "self._y = self._x0")
    add("Adder", "a:input b:input y:output", calc="self._y = self._a + self._b", depends="y:a,b")
    # two independent channels: no variable depends on itself when two are cross-connected
    channels = "self._y = self._a + 1.0\nself._z = self._b"
    add("Crossed", "a:input b:input y:output z:output", calc=channels, depends="y:a z:b")
    # y is a state, z passes u through
    state = "self._y = self._y + 1.0\nself.calc()"
    add("Mixed", "u:input y:output z:output", state, "self._z = self._u", "z:u")
    add(
        "Logic", "bi:input:Boolean ii:input:Integer bo:output:Boolean io:output:Integer",
        calc="self._bo = not self._bi\nself._io = self._ii + 1", depends="bo:bi io:ii",
    )  # fmt: skip
    add(
        "Loud", "y:output",  # its libraries warn whoever programs with them
        "import numpy, warnings\nnumpy.log(numpy.zeros(1))\nnumpy.full(1, 1e300) * 1e300\n"
        "warnings.warn('of the user')\nself._y = t",
    )  # fmt: skip
    add("Derived", "k:parameter:Real:1 twice:calculatedParameter y:output", calc="self._twice = 2 * self._k")
    add(
        "Counter", "n:output:Integer odd:output:Boolean word:parameter:String:none told:output:String",
        "self._n += 1\nself._odd = self._n % 2 == 1", "self._told = self._word\nself._odd = self._word == 'gr\u00fcn'",
    )  # fmt: skip
    add(
        "Fragile",  # mode 0: exception, 1: returns False, 2: only warns, 3: exception in initialization mode, 4: both
        "y:output at:parameter:Real:1e9 mode:parameter:Integer",
        "if t >= self._at - 1e-9:\n"
        "    if self._mode == 0:\n        raise ValueError('q[3] is not finite: 100 %s')\n"
        "    if self._mode == 4:\n        self.log('the table %s ends', Fmi2Status.error)\n        [][3]\n"
        "    self.log('the load is 50 %s of nominal', Fmi2Status.warning)\n"
        "    if self._mode == 1:\n        return False\n"
        "self._y = t + h",
        more="def exit_initialization_mode(self):\n    self.initializing = False\n"
        "    if self._mode == 3:\n        raise ValueError('no start possible')\n",
    )
    add(
        "Choosy", "u:input y:output h_max:parameter:Real:0.1",  # a state that takes no step longer than h_max
        "self._y = self._y + h * self._u\n"
        "if h > self._h_max:\n    self.log('the step is too long', Fmi2Status.warning)\nreturn h <= self._h_max",
    )  # fmt: skip
    add(
        "Clock",  # a state, and the whole seconds that have passed; for short steps and for whole ones
        "u:input y:output n:output:Integer",
        "self._y = self._y + h * (1.0 + self._u)\nself._n = int(t + h + 1e-12)\nreturn not 0.01 < h < 0.9",
    )
    add(
        "Reader", "u:input i:input:Integer y:output seen:output:Integer",
        calc="self._y = -self._u\nself._seen = self._i", depends="y:u seen:i",
    )  # fmt: skip
    add("Jump", "y:output", "self._y = float(t + h >= 0.5)", discrete=("y",))
    talk = "self.log('a step', Fmi2Status.warning)\nself._y = self._y + h * self._u"
    add("Talker", "u:input y:output:Real:1", talk)
    add("Refuser", "n:output:Integer", "return h <= 0.1")
    add(
        "Telling", "u:input y:output told:output x0:parameter",  # x' = u, and its input
        "self._y += h * self._u\nself._told = self._u", "self._y = self._x0\nself._told = self._u", "told:u",
    )  # fmt: skip
    # a step that does not say that it is none
    add("Late", "y:output at:parameter", "self._y = float(t + h >= self._at)")
    # y' = u - y, exact for a constant input
    add("Lag", "u:input y:output", "self._y = self._u + (self._y - self._u) * 2.718281828459045 ** -h")
    add(
        "Sprung",  # x'' = f = k (p - x), exact for a constant p
        "p:input f:output x:output v:output k:parameter:Real:4",
        "from math import cos, sin, sqrt\n"
        "a, v, w = self._x - self._p, self._v, sqrt(self._k)\n"
        "self._x = self._p + a * cos(w * h) + v / w * sin(w * h)\n"
        "self._v = v * cos(w * h) - w * a * sin(w * h)\n"
        "self.calc()",
        "self._f = self._k * (self._p - self._x)", "f:p",
    )  # fmt: skip
    # p' = cos(t) - f / 4, exact for a constant f
    carried = "from math import sin\nself._p += sin(t + h) - sin(t) - 0.25 * h * self._f"
    add("Carrier", "f:input p:output", carried)
    inverse = "self._y = 1.0 / self._u if self._u else float('inf')"
    add("Dividing", "u:input y:output", calc=inverse, depends="y:u")
    add("Speaker", "word:output:String", "self._word += '\u00fc'")
    add("Echo", "word:input:String again:output:String", calc="self._again = self._word", depends="again:word")
    count = "self._n = self._word.count('\u00fc')"
    add("Listener", "word:input:String n:output:Integer", calc=count, depends="n:word")
    # says of no output that it depends on nothing
    ports = " ".join(f"u{i}:input y{i}:output" for i in range(40))
    add("Wide", ports, "pass", "for i in range(40):\n    setattr(self, f'_y{i}', float(i))", None)
    # a discrete output for the input of the moment
    product = "self._u = self._k * self._x"
    add("Digital", "x:input u:output k:parameter:Real:1", calc=product, depends="u:x", discrete=("u",))
    switch = "self._up = self._u < -0.1 or (self._up and self._u <= 0.1)"
    add("Relay", "u:input up:output:Boolean:True", switch, depends="up:u")
    for motor, depends in (("Motor", ""), ("DirectMotor", "y:up")):  # the second says too much
        add(motor, "up:input:Boolean:True y:output", "self._y += h * (1.0 if self._up else -1.0)", depends=depends)
    tens = "self._y = 10.0 * getattr(self, '_k[1]') + getattr(self, '_k[2]')"
    add("Array", "k[1]:parameter k[2]:parameter y:output", calc=tens)
    degree, celsius = {"rad": "1", "factor": "0.017453292519943295"}, {"K": "1", "offset": "273.15"}
    add(
        "Degrees", "y:output:Real:0:deg mm:output:Real:0:mm degC:output:Real:0:degC",
        "self._y += 90.0\nself._mm += 1500.0\nself._degC += 10.0",
        units={"deg": degree, "mm": {"m": "1", "factor": "0.001"}, "degC": celsius},
    )  # fmt: skip
    add(
        "Radians", "u:input:Real:0:rad m:input:Real:0:m K:input:Real:0:K width:parameter:Real:1:m y:output:Real:0:m",
        "pass", "self._y = self._width", units={"rad": {"rad": "1"}, "m": {"m": "1"}, "K": {"K": "1"}},
    )  # fmt: skip
    return built


def component(name: str, fmu: str, connectors: str = "", bindings: str = "", attributes: str = "") -> str:
    """Return the XML of a component; `connectors` as in "u:input y:output:Real:rad"."""
    return texts.component(name, f"resources/{fmu}.fmu", connector_list(connectors) + bindings, attributes)


IN_PROCESS = {
    "test_algorithms", "test_check", "test_clocks", "test_compiled", "test_continuous", "test_derivatives",
    "test_ends", "test_events", "test_experiment", "test_failures", "test_fmi3", "test_foreign", "test_inputs",
    "test_linear", "test_loops", "test_model_exchange", "test_multirate", "test_observer",
    "test_recorder", "test_simulator", "test_systems",
}  # fmt: skip
"""Tests of signals and steps, which are the same in this process and in one of their own, except for its start."""


@pytest.fixture(autouse=True)
def in_process(request, monkeypatch):
    """Run components in this process where nothing is said of isolation, for the tests of `IN_PROCESS`."""
    if request.module.__name__.rpartition(".")[2] in IN_PROCESS:
        plain = simulator.unpack_units
        monkeypatch.setattr(simulator, "unpack_units", lambda checked, folder: (plain(checked, folder)[0], False))


@pytest.fixture
def pack(tmp_path, fmus):
    def write(
        elements: list[str],
        connections: list[str] | tuple[()] = (),
        *,
        connectors: str = "",
        bindings: str = "",
        units: str = "",
        extra: Mapping[str, str | bytes] | None = None,
        experiment: str = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>',
        name: str = "test.ssp",
    ) -> Path:
        items = "".join(c if c.startswith("<") else connection(c) for c in connections)
        parts = "".join(e if e.startswith("<") else component(*e.split(maxsplit=2)) for e in elements)
        text = texts.ssd(
            f"{connector_list(connectors)}{bindings}<ssd:Elements>{parts}</ssd:Elements>"
            + (f"<ssd:Connections>{items}</ssd:Connections>" if items else ""),
            (f"<ssd:Units>{units}</ssd:Units>" if units else "") + experiment, name="test",
        )  # fmt: skip
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


@pytest.fixture(scope="session")
def arm_package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")

    @cache
    def make(backend: str = "native") -> Path:
        scenario = load_scenario("planar_tracking")
        return write_ssp(scenario, cached_fmus(scenario, folder / backend, backend), folder / f"{backend}.ssp")

    return make


@pytest.fixture
def package(arm_package) -> Path:
    return arm_package()


@pytest.fixture(scope="session")
def strict(tmp_path_factory) -> Path:
    """Return the FMU of strict.c, of which y is the time."""
    return write_strict(tmp_path_factory.mktemp("strict"))


class Xml:
    """The texts of systems as one fixture, with the components of `pack`."""

    component = staticmethod(component)
    connection = staticmethod(connection)
    values = staticmethod(partial(texts.values, name="set"))
    real = staticmethod(lambda name, value, unit="": texts.parameter(name, value, unit=unit))
    integer = staticmethod(partial(texts.parameter, kind="Integer"))
    connector_list = staticmethod(connector_list)


@pytest.fixture(scope="session")
def xml():
    return Xml


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    folder, archives = tmp_path_factory.mktemp("reference"), {}

    def once(model: models.Model | Reference, version: str = "3.0") -> bytes:
        key = model.name, version
        if key not in archives:
            path = (
                model.build(version, folder) if isinstance(model, Reference) else models.build(model, version, folder)
            )
            archives[key] = path.read_bytes()
        return archives[key]

    return once


@pytest.fixture
def loop(pack, xml):
    """Return a controlled plant x' = u, u = G r + K (r - x) with K = 1.5, in an order that is wrong for stepping."""
    return pack(
        ["plant Plant u:input y:output", "trajectory Ramp y:output", "controller Adder a:input b:input y:output",
         "error Adder a:input b:input y:output", "feedforward Gain u:input y:output"],
        ["trajectory.y -> feedforward.u", "trajectory.y -> error.a",
         "feedforward.y -> controller.a",
         xml.connection("plant.y -> error.b", '<ssc:LinearTransformation factor="-1"/>'),
         xml.connection("error.y -> controller.b", '<ssc:LinearTransformation factor="1.5"/>'),
         "controller.y -> plant.u"],
    )  # fmt: skip


@pytest.fixture
def system(pack, built):
    def write(components, connections=(), bindings: dict[str, str] | None = None) -> Path:
        elements, extra = [], {}
        used = [end.partition(".")[::2] for c in connections for end in c.split(" -> ")]
        for name, (model, version) in components.items():
            fmu = f"{model.name}_{version[0]}"
            kinds = model.causalities(version)
            ports = dict.fromkeys(port for owner, port in used if owner == name)
            text = " ".join(f"{port}:{kinds[port.partition('[')[0]]}" for port in ports)
            elements.append(component(name, fmu, text, (bindings or {}).get(name, "")))
            extra[f"resources/{fmu}.fmu"] = built(model, version)
        return pack(elements, connections, extra=extra)

    return write


@pytest.fixture
def results() -> Results:
    """Return signals that are hard to write."""
    return hard_results()
