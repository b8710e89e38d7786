"""A system over several processes gives what one process gives with jacobi, to the last bit."""

import json

import numpy as np
import pytest

import vdfmu
from tests.engine.files import assert_same_bits
from tests.engine.reference import models
from vdfmu.engine.federation import CORES
from vdfmu.engine.package_run import run_system

LOOP = ["r.y -> a.a", "g.y -> a.b", "a.y -> p.u", "p.y -> g.u"]


@pytest.fixture
def loop(pack, xml):
    """Return a package of a ramp and a plant, with feedback through a gain and an adder that pass on at once."""
    c = xml.component
    return pack(
        [
            "r Ramp y:output",
            "a Adder a:input b:input y:output",
            c("p", "Plant", "u:input y:output", xml.values(xml.real("x0", 0.3))),
            c("g", "Gain", "u:input y:output", xml.values(xml.real("k", -1.7))),
        ],
        LOOP,
    )


def assert_same(split, whole):
    """Assert that both have the same signals, in the same order, with the same bits."""
    assert split.names == whole.names
    assert_same_bits(split, whole)


@pytest.mark.heavy
@pytest.mark.parametrize("split", [["p"], ["a,p"], ["r", "g,a"], ["p", "a", "g"]], ids="|".join)
def test_two_three_and_four_federates_give_the_bits_of_jacobi(loop, federates, split):
    options = {"stop": 1.0, "step": 0.1}
    whole = vdfmu.simulate(loop, algorithm="jacobi", **options)
    results = vdfmu.federate(loop, split, **options)
    assert_same(results, whole)
    assert np.ptp(whole["p.y"]) > 0.1  # it moves at all
    parts = results.summary["federates"]
    assert [name for part in parts.values() for name in part["components"]] == [*",".join(split).split(","), *(
        name for name in "rapg" if name not in ",".join(split)
    )]  # fmt: skip
    assert all(part["waited_s"] > 0.0 for part in parts.values())


@pytest.mark.heavy
@pytest.mark.parametrize("core", CORES[1:])
def test_every_core_of_helics_gives_the_same(loop, federates, core):
    whole = vdfmu.simulate(loop, algorithm="jacobi", stop=1.0, step=0.1)
    assert_same(vdfmu.federate(loop, ["p", "a"], core=core, stop=1.0, step=0.1), whole)


@pytest.mark.heavy
def test_the_arm_in_two_and_four_federates_gives_the_bits_of_jacobi(arm_package, tmp_path, federates):
    package = arm_package()
    run_system(package, master="jacobi", stop=0.1, out=tmp_path / "one")
    for split in (["plant"], ["plant", "feedforward", "controller"]):
        out = tmp_path / f"{len(split)}"
        run_system(package, federation=vdfmu.engine.federation.Federation(split), stop=0.1, out=out)
        assert (out / "results.csv").read_bytes() == (tmp_path / "one" / "results.csv").read_bytes()
        held = [json.loads((folder / "summary.json").read_text())["held"] for folder in (out, tmp_path / "one")]
        assert sorted(held[0]) == sorted(held[1])


@pytest.mark.heavy
def test_values_of_every_type_are_carried(system, federates):
    """From one component to another and back: each feeds what it gets through, texts and binary values too."""
    model = models.FEEDTHROUGH
    kinds = [v.name.removesuffix("_input") for v in model.variables if v.causality == "input"]
    path = system(
        {"a": (model, "3.0"), "b": (model, "3.0")},
        [f"a.{k}_output -> b.{k}_input" for k in kinds] + [f"b.{k}_output -> a.{k}_input" for k in kinds],
    )
    values = {f"a.{k}_input": 1 for k in kinds if "Int" in k}
    options = {"stop": 0.6, "step": 0.2, "parameters": values}
    whole = vdfmu.simulate(path, algorithm="jacobi", **options)
    assert_same(vdfmu.federate(path, ["a"], **options), whole)


@pytest.mark.heavy
def test_the_initialization_passes_from_federate_to_federate(pack, xml, fmus, federates):
    """A start value goes through three federates; a loop through two is solved as in one process."""
    c = xml.component
    path = pack(
        [
            c("d", "Derived", "twice:calculatedParameter y:output", xml.values(xml.real("k", 1.5))),
            "g Gain u:input y:output k:parameter",
            "r Ramp y:output slope:parameter",
            "a Adder a:input b:input y:output",
            c("h", "Gain", "u:input y:output", xml.values(xml.real("k", 0.5))),
        ],
        ["d.twice -> g.k", "d.twice -> r.slope", "r.y -> g.u", "g.y -> a.a", "h.y -> a.b", "a.y -> h.u"],
    )
    options = {"start": 1.0, "stop": 2.0, "step": 0.25, "record": ["*"]}
    whole = vdfmu.simulate(path, algorithm="jacobi", **options)
    assert whole["g.u"][0] == 3.0  # slope 2 k at t = 1 s
    assert whole["g.y"][0] == 9.0
    assert whole["a.y"][0] == pytest.approx(18.0, rel=1e-8)  # y = 9 + y / 2, to the convergence 1e-8 of the loop
    assert_same(vdfmu.federate(path, ["d", "g", "r", "h"], **options), whole)


@pytest.mark.heavy
def test_signals_from_files_units_of_measurement_and_own_steps(pack, xml, federates):
    c = xml.component
    own_step = (
        '<ssd:Annotations><ssc:Annotation type="org.vdfmu.experiment"><Experiment xmlns="urn:org.vdfmu:experiment" '
        'communicationStepSize="0.5"/></ssc:Annotation></ssd:Annotations>'
    )
    path = pack(
        [
            "deg Degrees y:output mm:output", "rad Radians u:input m:input",
            c("p", "Plant", "u:input load:input y:output", own_step), "g Gain u:input y:output",
        ],
        ["deg.y -> rad.u", "deg.mm -> rad.m", "g.y -> p.u", "p.y -> g.u"],
    )  # fmt: skip
    t = np.linspace(0.0, 1.0, 5)
    options = {"stop": 1.0, "step": 0.25, "inputs": {"p.load": (t, np.sin(3.0 * t))}}
    whole = vdfmu.simulate(path, algorithm="jacobi", **options)
    assert whole["p.y"][-1] != 0.0
    assert_same(vdfmu.federate(path, ["deg", "p"], **options), whole)


@pytest.mark.heavy
def test_a_component_that_ends_the_simulation_ends_it_for_all_and_for_model_exchange(system, federates):
    """As in one process: with the same rows, and the same words."""
    path = system({"b": (models.BOUNCING_BALL, "2.0"), "c": (models.FEEDTHROUGH_2, "2.0")}, ["b.h -> c.Float64_input"])
    whole = vdfmu.simulate(path, algorithm="jacobi", stop=3.0, step=0.05)
    results = vdfmu.federate(path, ["b"], stop=3.0, step=0.05)
    assert_same(results, whole)
    for key in ("ended", "stop", "steps", "notes"):
        assert results.summary.get(key) == whole.summary.get(key)
    path = system({"d": (models.VAN_DER_POL, "2.0"), "c": (models.FEEDTHROUGH_2, "2.0")}, ["d.x0 -> c.Float64_input"])
    whole = vdfmu.simulate(path, algorithm="jacobi", stop=1.0, step=0.1)
    assert_same(vdfmu.federate(path, ["d"], stop=1.0, step=0.1), whole)
