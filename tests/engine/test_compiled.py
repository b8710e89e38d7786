"""Steps in compiled code give the bits, failures and messages of steps in Python, and are used where they can be."""

import os
import re
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import heavy
from tests.engine.files import assert_same_bits
from tests.engine.reference import models
from tests.engine.reference.masses import RATES, UPDATES, WIRES
from tests.engine.reference.models import V
from tests.engine.reference_fmus import BALL, DAHLQUIST, RESOURCE, STAIR, VAN_DER_POL
from tests.engine.texts import OWN_STEP
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.interrupt import listening
from vdfmu.engine.algorithms import named
from vdfmu.engine.masters import compiled
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.run import Interrupted, Results, Simulator, isolated, simulate

HELD = named(substeps=1)
NUMBERS = models.feedthrough(tuple(kind for kind in models.SCALARS if kind not in ("String", "Binary")), "Numbers")
NUMBERS_2 = models.feedthrough(("Float64", "Int32", "Boolean"), "Numbers2")
EXTREMES = {"Float64": 0.1, "Float32": 0.1, "Boolean": True, "Enumeration": 2} | {
    name: np.iinfo(name.lower()).min for name in models.INTEGERS if name != "UInt64"
} | {"UInt64": 2**63 - 1}  # fmt: skip
GROWING = models.Model(
    "Growing",
    [V("x", "output", start=0.0), V("der(x)"), V("n", "output", "Int32", needs=("x",)),
     V("k", "parameter", start=10.0)],
    "static void outputs(Instance *I) { I->d.der_x = I->d.k; I->d.n = (int)I->d.x; }\n", step=0.1, states=("x",),
)  # fmt: skip
EVENTFUL = models.feedthrough(("Int32", "Boolean"), "Events", models.EVENTS)
ALONE = {"dahlquist": DAHLQUIST, "van der pol": VAN_DER_POL, "resource": RESOURCE}


@pytest.fixture
def packaged(system, pack, built, xml, arm_package, strict):
    """Return a function that packs a system by its name; it returns the package and options of its run."""

    def scaled(version):
        link = xml.connection("b.x -> a.u", '<ssc:LinearTransformation factor="-1.5" offset="0.5"/>')
        lags = [f"{name} Lagging u:input x:output" for name in "ab"]
        return pack(lags, ["a.x -> b.u", link], extra={"resources/Lagging.fmu": built(models.LAG, version)})

    def rates(version):
        hints = {name: OWN_STEP.format(step) for name, step in {"slow": 0.3, "gain": 0.2}.items()}
        units = {"fast": (VAN_DER_POL, version), "gain": (NUMBERS_2, version)}
        units |= dict.fromkeys(("slow", "after"), (models.LAG, version))
        links = ["fast.x0 -> gain.Float64_input", "gain.Float64_output -> slow.u", "slow.x -> after.u"]
        return system(units, links, hints)

    def types():
        units = {"a": (NUMBERS, "3.0"), "two": (NUMBERS_2, "2.0"), "b": (NUMBERS, "3.0")}
        links = [f"a.{kind}_output -> b.{kind}_input" for kind in EXTREMES if kind not in ("Float32", "Int8")]
        links += ["a.Int8_output -> two.Int32_input", "two.Int32_output -> b.Int8_input"]
        links += ["a.Float32_output -> two.Float64_input", "two.Float64_output -> b.Float32_input"]
        return system(units, links), {"parameters": {f"a.{kind}_input": value for kind, value in EXTREMES.items()}}

    def widened():
        units = {"a": (NUMBERS, "3.0"), "two": (NUMBERS_2, "2.0"), "s": (models.STATE_SPACE, "3.0")}
        units |= {f"f{i}": (NUMBERS, "3.0") for i in range(len(EXTREMES))}
        links = [f"a.{kind}_output -> f{i}.Float64_input" for i, kind in enumerate(EXTREMES)]
        links += ["a.Boolean_output -> f0.Int64_input", "a.Enumeration_output -> f0.UInt8_input"]
        links += ["f0.UInt8_output -> two.Float64_input", "two.Boolean_output -> s.u[2]", "two.Int32_output -> s.u[3]"]
        links.append("two.Boolean_output -> f1.Int8_input")
        values = {f"a.{kind}_input": value for kind, value in EXTREMES.items()}
        return system(units, links), {"parameters": values | {"two.Boolean_input": True, "two.Int32_input": -7}}

    def arrays():
        units = {"k": (NUMBERS_2, "2.0"), "s": (models.STATE_SPACE, "3.0"), "t": (models.STATE_SPACE, "3.0")}
        return system(units, ["k.Float64_output -> s.u[2]", "s.y[3] -> t.u[1]", "s.y[1] -> t.u[3]"])

    def events(units, links=(), **options):
        return lambda: (system({name: (model, "3.0") for name, model in units.items()}, links), options)

    made = {"types": types, "widened": widened, "arrays": arrays, "arm": lambda: (arm_package(), {"step": 1e-3})}
    made["ball"] = events({"b": BALL, "f": models.LAG}, ["b.h -> f.u"])
    stairs = {"s": STAIR, "a": EVENTFUL, "b": EVENTFUL}
    made["stair"] = events(stairs, ["s.counter -> a.Int32_input", "a.Int32_output -> b.Int32_input"], step=0.7)
    made["counted"] = events({"s": STAIR, "f": models.LAG, "g": EVENTFUL},
                            ["s.counter -> f.u", "s.counter -> g.Int32_input"], step=0.7)  # fmt: skip
    made["loop"] = events({"c": models.CONTROLLER, "p": models.LAG}, ["p.x -> c.e", "c.u -> p.u"], step=0.15)
    made["clocks"] = events({"k": models.CLOCKS, "n": models.COUNTER}, ["k.outClock -> n.c"], step=0.3)
    for version in ("2.0", "3.0"):
        made |= {f"scaled {version}": lambda v=version: scaled(v), f"rates {version}": lambda v=version: rates(v)}
        for name, model in ALONE.items():
            made[f"{name} {version}"] = lambda m=model, v=version: system({"m": (m, v)})
        texts = (models.FEEDTHROUGH if version == "3.0" else models.FEEDTHROUGH_2, version)
        units = {"v": (VAN_DER_POL, version), "t": texts, "f": (models.LAG, version)}
        links = ["v.x0 -> t.Float64_input", "t.Float64_output -> f.u"]
        pair = {name: (RATES, version) for name in "ab"}
        made[f"slopes {version}"] = lambda pair=pair: (system(pair, WIRES), {"parameters": {"a.x": 1.0}})
        made[f"texts {version}"] = lambda units=units, links=links: system(units, links)
    made["strict"] = lambda: pack(["unit Strict y:output"], extra={"resources/Strict.fmu": strict.read_bytes()})

    def make(name):
        package = made[name]()
        return package if isinstance(package, tuple) else (package, {})

    return make


NAMES = [
    "types", "widened", "arrays", "arm", "strict", "ball", "stair", "counted", "loop", "clocks",
    *(f"{kind} {version}" for version in ("2.0", "3.0") for kind in ("scaled", "rates", "texts", "slopes", *ALONE)),
]  # fmt: skip
SAMPLED = "rates", "loop", "clocks"
"""Start of the names of systems that continuous algorithms refuse."""
REPEATED = "arm", "scaled", "slopes"
"""Start of the names of systems with loops, in which `iterative` repeats steps."""


@pytest.fixture
def both():
    """Return a function that runs a system by fmpy and in C, here and, if `apart`, in a separate process.

    It returns the same results or failure.
    """

    def run(package, apart=True, **options) -> Results | CosimError:
        outcomes = []
        for stepper, isolate in (("fmpy", False), ("c", False), ("c", True))[: 2 + apart]:
            said = []
            try:
                results = outcome = simulate(package, stepper=stepper, isolate=isolate, log=said.append, **options)
            except CosimError as error:
                outcome, results = error, error.results
            assert results.summary["stepper"] == {"c": "c", "fmpy": "fmpy: chosen"}[stepper]
            outcomes.append((outcome, results, said))
        (by_fmpy, results_fmpy, expected), *in_c = outcomes
        for outcome, results, said in in_c:
            assert_same_bits(results, results_fmpy)
            assert said == expected
            assert (type(outcome), str(outcome)) == (type(by_fmpy), str(by_fmpy)) or isinstance(by_fmpy, Results)
            assert results.summary["notes"] == results_fmpy.summary["notes"]
            for fact in ("ended", "communication"):
                assert results.summary.get(fact) == results_fmpy.summary.get(fact)
        return outcome

    return run


@pytest.mark.few(6)
@pytest.mark.parametrize(("name", "algorithm"), [
    *((name, algorithm) for name in NAMES for algorithm in HELD),
    *((name, "extrapolated") for name in NAMES if not name.startswith(SAMPLED)),
    *((name, "iterative") for name in NAMES if not name.startswith((*SAMPLED, *REPEATED))),
])  # fmt: skip
def test_all_systems_have_the_same_bits(packaged, both, name, algorithm):
    package, options = packaged(name)
    step = options.pop("step", 0.1)
    apart = algorithm == "gauss-seidel" or name in ("types", "arm")  # a process takes a quarter of a second to start
    results = both(package, apart, step=step, stop=20 * step, algorithm=algorithm, record=["*"], **options)
    assert len(results) == (14 if name in ("stair", "counted") else 21)  # the stair ends at 9 s, in the step from 8.4 s
    assert name.startswith(("types", "widened", "resource")) or any(
        (results[each][1:] != results[each][0]).any() for each in results
    )


@pytest.mark.parametrize(
    ("fault", "said"),
    [("refuse", "the oil is too cold (status error)"),  # and no debug text
     *heavy(("mute", "the unit gave no reason; its last message: debug: fmi2DoStep ends (status error)"),
            ("discard", "too long"),  # a step that is discarded and does not end the simulation
            ("inf_from", "y is -inf")),
     *heavy(("nan_from", "y is nan"), ("end", ""))],
)  # fmt: skip
def test_failures_and_ends_name_component_call_and_time(packaged, both, fault, said):
    package, _ = packaged("strict")
    outcome = both(package, step=0.25, stop=2.0, parameters={f"unit.{fault}": 0.6})
    if fault == "end":
        assert outcome.summary["ended"] == {"component": "unit", "time": 0.6}
    else:
        assert (outcome.unit, outcome.call, outcome.time) == ("unit", "doStep", 0.75 if said[0] != "y" else 0.5)
        assert f"doStep: {said}" in str(outcome)


class Kept(Tap):
    """Keeps a signal."""

    wanted, size = ("m.x0",), 7

    def __init__(self):
        self.values = []

    def block(self, times, values):
        """See `Tap`."""
        self.values += values[:, 0].tolist()


@pytest.mark.parametrize("words", [*heavy(1), 50])
def test_rows_come_from_another_process_block_by_block(packaged, tmp_path, monkeypatch, words):
    """Blocks of 1 row, and of 16 with 3 words each, which end where no block of the file or of the tap ends."""
    monkeypatch.setattr(isolated, "_WORDS", words)
    (package, _), tap, path = packaged("van der pol 3.0"), Kept(), tmp_path / "rows.csv"
    with Simulator(package, isolate=True, stepper="c") as simulator:
        results = simulator.run(step=0.01, stop=6.0, taps=[tap], stream=path)
    expected = simulate(package, step=0.01, stop=6.0, isolate=False)
    assert_same_bits(results, expected)
    assert_same_bits(Results.read(path), expected)
    assert tap.values == expected["m.x0"].tolist()


@pytest.mark.heavy
def test_a_unit_of_version_3_ends_the_simulation(system, both):
    """The stair ends it at 9 s. Components with their own steps have no events."""
    hints = {name: OWN_STEP.format(step) for name, step in {"m": 1.0, "n": 0.5}.items()}
    results = both(system({"m": (STAIR, "3.0"), "n": (DAHLQUIST, "3.0")}, (), hints), step=0.5, stop=12.0)
    assert results.summary["ended"] == {"component": "m", "time": 9.0}


def test_ctrl_c_ends_a_run_within_a_slice(packaged):
    """The steps take a second or more."""
    package, _ = packaged("dahlquist 2.0")
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))

    def begin(done, _):
        if done and timer.ident is None:  # a busy machine may take long until the first step
            timer.start()

    with listening(signal.SIGINT), pytest.raises(Interrupted) as info:
        simulate(package, step=0.1, stop=1e6, progress=begin)
    assert 0 < len(info.value.results) < 1e7
    assert info.value.results.summary["stepper"] == "c"


def test_an_integer_out_of_range_is_refused_when_it_is(system, both):
    """N = 10 t is 128 after 12.8 s."""
    path = system({"a": (GROWING, "2.0"), "b": (NUMBERS, "3.0")}, ["a.n -> b.Int8_input"])
    error = both(path, step=0.1, stop=20.0)
    assert re.search(r"b failed at t = 12\.\d s in setInt8: expected a value of type Int8, got 128", str(error))


def test_the_reason_for_steps_by_fmpy_is_in_the_summary(system, packaged, monkeypatch):
    def stepper(path, **options):
        return simulate(path, stop=0.2, step=0.1, **options).summary["stepper"]

    texts = system({name: (models.FEEDTHROUGH_2, "2.0") for name in "ab"}, ["a.String_output -> b.String_input"])
    assert stepper(texts) == "fmpy: texts or binary values between components"
    package, _ = packaged("dahlquist 2.0")
    assert stepper(package) == "c"
    arrays = replace(models.STATE_SPACE, name="Slopes", simulation={"maxOutputDerivativeOrder": "1"})
    parts = system({name: (arrays, "3.0") for name in "ab"}, ["a.y[2] -> b.u[1]"])
    assert stepper(parts, algorithm="extrapolated") == "fmpy: rates of parts of an array"
    updates = system({"m": (UPDATES, "3.0"), "v": (VAN_DER_POL, "3.0")}, ["v.x0 -> m.x_o"])
    assert stepper(updates, algorithm="extrapolated") == "fmpy: m takes its inputs within steps"
    assert stepper(package, stepper="fmpy") == "fmpy: chosen"
    said = r"stepper: must be fmpy or auto here, got c\. The steps cannot be made in C: steps that may be repeated\."
    with pytest.raises(UsageError, match=said):
        stepper(package, stepper="c", algorithm="extrapolated", adaptive=1e-3)
    with pytest.raises(UsageError, match=r"stepper: must be auto, fmpy or c, got 'rust'\."):
        stepper(package, stepper="rust")
    monkeypatch.setattr(compiled, "library", lambda: None)
    assert stepper(package) == "fmpy: no C compiler"
