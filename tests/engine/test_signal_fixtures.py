"""Systems like the fixtures of pyssporg/ssp_references, of units of our own: each signal as its formula says.

The repository states no licence, so none of its files is here: only the structure and the numbers of its fixtures.
"""

import re
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from tests.engine import signal_units
from tests.engine.reference import models
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import SspError
from vdfmu.engine.run import simulate
from vdfmu.unit import table_unit

H = 2.0**-6
"""Step [s], of which every time is a multiple without rounding."""
T = np.arange(65) * H
PORTS = {
    "Step": "height:parameter:Real offset:parameter:Real startTime:parameter:Real:s y:output:Real",
    "Sine": "amplitude:parameter:Real f:parameter:Real:Hz offset:parameter:Real phase:parameter:Real:rad "
            "startTime:parameter:Real:s y:output:Real",
    "Gain": "k:parameter:Real u:input:Real y:output:Real",
    "Add": "k1:parameter:Real k2:parameter:Real u1:input:Real u2:input:Real y:output:Real",
    "Product": "u1:input:Real u2:input:Real y:output:Real",
}  # fmt: skip
SPACE = 'xmlns:{0}="http://ssp-standard.org/SSP1/SystemStructureParameter{1}" version="1.0"'


class Fixture(NamedTuple):
    """A system, and its signals."""

    elements: list[str]
    connections: list[str]
    signals: dict[str, Floats]
    options: dict = {}
    """For `pack`: bindings, connectors and other members of the package."""


def step(at: float, height: float = 1.0, offset: float = 0.0) -> Floats:
    return offset + height * (T >= at)


def sine(amplitude: float, f: float, offset: float = 0.0) -> Floats:
    return offset + amplitude * np.sin(2.0 * np.pi * f * T)


def fixtures(xml) -> dict[str, Fixture]:
    def c(name, values=""):
        unit = name.partition("_")[0].capitalize()
        return xml.component(name, f"blocks/{unit}", PORTS[unit], inline(values), 'implementation="CoSimulation"')

    def numbers(text):
        pairs = (item.split("=") for item in text.split())
        return "".join(xml.real(name, float(x)) for name, x in pairs)

    def inline(text, mapping=""):
        return xml.values(numbers(text), mapping=mapping) if text else ""

    def inner(elements, connections, connectors, bindings=""):
        wires = "".join(map(xml.connection, connections))
        return (
            f'<ssd:System name="inner">{xml.connector_list(connectors)}{bindings}<ssd:Elements>{"".join(elements)}'
            f"</ssd:Elements><ssd:Connections>{wires}</ssd:Connections></ssd:System>"
        )

    def bound(mapped=False):
        more = '<ssd:ParameterMapping source="resources/m.ssm"/>' if mapped else ""
        binding = f'<ssd:ParameterBinding source="resources/p.ssv">{more}</ssd:ParameterBinding>'
        return f"<ssd:ParameterBindings>{binding}</ssd:ParameterBindings>"

    def files(text, mapped=""):
        entries = (item.split("=") for item in mapped.split())
        entry = "".join(f'<ssm:MappingEntry source="{a}" target="{b}"/>' for a, b in entries)
        return {
            "resources/p.ssv": f'<ssv:ParameterSet {SPACE.format("ssv", "Values")} name="s"><ssv:Parameters>'
            f"{numbers(text)}</ssv:Parameters></ssv:ParameterSet>",
            "resources/m.ssm": f"<ssm:ParameterMapping {SPACE.format('ssm', 'Mapping')}>{entry}</ssm:ParameterMapping>",
        }

    def external(text):
        """Values under the names of the variables."""
        return {"bindings": bound(), "extra": files(text)}

    def mapped(text):
        """Values under names that a mapping translates: step_height for step.height."""
        pairs = [item.split("=") for item in text.split()]
        flat = " ".join(f"{name.replace('.', '_')}={x}" for name, x in pairs)
        mapping = " ".join(f"{name.replace('.', '_')}={name}" for name, _ in pairs)
        return {"bindings": bound(True), "extra": files(flat, mapping)}

    s, parameters = step(0.25), "height=1 offset=0 startTime=0.25"
    quarter = "step.height=1 step.offset=0 step.startTime=0.25"
    waves = "sine.amplitude={} sine.f={} sine.offset={} sine.phase=0 sine.startTime=0".format
    late = step(0.5, 2.0)
    wave, loud, high = sine(1.0, 2.0), sine(2.0, 5.0, 0.5), sine(0.5, 2.0, 1.0)
    return {
        "signal_step_gain": Fixture(
            [c("step"), c("gain")], ["step.y -> gain.u"], {"step.y": s, "gain.y": 2.0 * s},
            external(f"{quarter} gain.k=2"),
        ),
        "signal_step_add": Fixture(
            [c("step_a"), c("step_b"), c("add")], ["step_a.y -> add.u1", "step_b.y -> add.u2"],
            {"step_a.y": s, "step_b.y": late, "add.y": s + late},
            mapped("step_a.height=1 step_a.startTime=0.25 step_b.height=2 step_b.startTime=0.5 add.k1=1 add.k2=1"),
        ),
        "signal_fanout_gain": Fixture(
            [c("step"), c("gain_a"), c("gain_b")], ["step.y -> gain_a.u", "step.y -> gain_b.u"],
            {"gain_a.y": 2.0 * s, "gain_b.y": -3.0 * s}, external(f"{quarter} gain_a.k=2 gain_b.k=-3"),
        ),
        "signal_sine_gain_add": Fixture(
            [c("sine"), c("step"), c("gain"), c("add")], ["sine.y -> gain.u", "gain.y -> add.u1", "step.y -> add.u2"],
            {"sine.y": sine(1.0, 1.0), "gain.y": 3.0 * sine(1.0, 1.0), "add.y": 3.0 * sine(1.0, 1.0) + late},
            {"bindings": inline(waves(1, 1, 0) + " step.height=2 step.startTime=0.5 gain.k=3 add.k1=1 add.k2=1")},
        ),
        "signal_step_product": Fixture(
            [c("step"), c("sine"), c("product")], ["step.y -> product.u1", "sine.y -> product.u2"],
            {"product.y": s * wave}, mapped(f"{quarter} {waves(1, 2, 0)}"),
        ),
        "signal_delay_detector": Fixture(
            [c("step"), c("gain_a"), c("gain_b"), c("add")],
            ["step.y -> gain_a.u", "gain_a.y -> gain_b.u", "gain_b.y -> add.u1", "step.y -> add.u2"],
            {"gain_b.y": s + 0.5, "add.y": 0.0 * s},
            external("step.height=1 step.offset=0.5 step.startTime=0.25 gain_a.k=1 gain_b.k=1 add.k1=1 add.k2=-1"),
        ),
        "signal_algebraic_loop": Fixture(
            [c("sine"), c("gain"), c("add")], ["sine.y -> add.u1", "gain.y -> add.u2", "add.y -> gain.u"],
            {"add.y": 2.0 * wave, "gain.y": wave}, external(f"{waves(1, 2, 0)} gain.k=0.5"),
        ),
        "signal_nested_algebraic_loop": Fixture(
            [c("sine"), c("gain_outer"), c("gain_inner"), c("add_outer"), c("add_inner")],
            ["sine.y -> add_outer.u1", "add_inner.y -> add_outer.u2", "add_outer.y -> gain_outer.u",
             "gain_outer.y -> add_inner.u1", "gain_inner.y -> add_inner.u2", "add_inner.y -> gain_inner.u"],
            {"add_outer.y": 2.0 * high, "add_inner.y": high, "gain_outer.y": 0.5 * high, "gain_inner.y": 0.5 * high},
            external(f"{waves(0.5, 2, 1)} gain_outer.k=0.25 gain_inner.k=0.5"),
        ),
        "signal_nested_external_bindings": Fixture(
            [c("step", parameters), inner([c("sine")], ["sine.y -> y"], "y:output:Real", bound(True))], ["step.y -> y"],
            {"step.y": s, "inner.sine.y": loud},
            {"connectors": "y:output:Real", "extra": files(
                "amplitude=2 f=5 offset=0.5", "amplitude=sine.amplitude f=sine.f offset=sine.offset")},
        ),
        "signal_nested_parameter_bindings": Fixture(
            [c("step", parameters), c("add"), inner(
                [c("sine"), c("gain", "k=0.5")], ["sine.y -> gain.u", "gain.y -> y"], "y:output:Real",
                inline(waves(1, 2, 0)))],
            ["step.y -> add.u1", "inner.y -> add.u2", "add.y -> y"],
            {"inner.sine.y": 2.0 * wave, "inner.gain.y": wave, "add.y": s + wave},
            {"connectors": "y:output:Real", **mapped("add.k1=1 add.k2=1 inner.sine.amplitude=2")},
        ),
        "signal_nested_pass_through": Fixture(
            [c("step", "height=1 offset=0 startTime=0"), c("add", "k1=1 k2=1"), inner(
                [c("gain", "k=1")], ["in -> gain.u", "gain.y -> out"], "in:input:Real out:output:Real")],
            ["step.y -> inner.in", "inner.out -> add.u1", "add.y -> y"],
            {"inner.gain.y": step(0.0), "add.y": step(0.0)}, {"connectors": "y:output:Real"},
        ),
        "signal_parameter_inline_with_mapping": Fixture(
            [c("step")], [], {"step.y": s},
            {"bindings": inline(
                "step_height=1 step_offset=0 step_startTime=0.25",
                '<ssd:ParameterMapping source="resources/m.ssm"/>'), "extra": files(
                "", "step_height=step.height step_offset=step.offset step_startTime=step.startTime")},
        ),
    }  # fmt: skip


@pytest.fixture(scope="session")
def blocks(tmp_path_factory):
    units = [getattr(signal_units, name) for name in (*PORTS, "Machine", "Mass", "Stimuli")]

    @cache
    def members(version):
        fmus = build_fmus(None, tmp_path_factory.mktemp("blocks"), units=units, fmi_version=version)
        return {f"resources/blocks/{path.name}": path.read_bytes() for path in fmus.values()}

    return members


VERSIONS = ["2.0", pytest.param("3.0", marks=pytest.mark.heavy)]
NAMES = (
    "signal_step_gain", "signal_step_add", "signal_fanout_gain", "signal_sine_gain_add", "signal_step_product",
    "signal_delay_detector", "signal_algebraic_loop", "signal_nested_algebraic_loop",
    "signal_nested_external_bindings", "signal_nested_parameter_bindings", "signal_nested_pass_through",
    "signal_parameter_inline_with_mapping",
)  # fmt: skip
LOOPS = ("signal_algebraic_loop", "signal_nested_algebraic_loop")
ROUNDING = 1e-14
"""Some ten operations with numbers of up to 3, 2e-16 each, which a loop of gain 1/2 doubles; a lag is above 0.1."""


@pytest.fixture
def packed(pack, xml, blocks):
    def make(name, version="2.0", more=()):
        elements, connections, signals, options = fixtures(xml)[name]
        extra = {**blocks(version), **options.get("extra", {})}
        return pack(elements, [*connections, *more], **{**options, "extra": extra}), signals

    return make


def test_all_are_there(xml):
    assert set(NAMES) == set(fixtures(xml))


@pytest.mark.few(4)
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", NAMES)
def test_iterative_is_exact_at_every_communication_point(packed, name, version):
    path, signals = packed(name, version)
    results = simulate(path, stop=1.0, step=H, algorithm="iterative")
    for signal, values in signals.items():
        np.testing.assert_allclose(results[signal], values, rtol=0.0, atol=ROUNDING, err_msg=signal)


@pytest.mark.parametrize("name", NAMES)
def test_gauss_seidel_is_exact_with_the_inputs_of_a_step_before(packed, name):
    path, signals = packed(name)
    if name in LOOPS:
        with pytest.raises(SspError, match="algebraic loop in the steps: .* iterative solves it"):
            simulate(path, stop=1.0, step=H)
        return
    results = simulate(path, stop=1.0, step=H)
    for signal, values in signals.items():
        lag = 0 if re.search(r"(step|sine)(_.)?\.y", signal) else 1
        np.testing.assert_allclose(results[signal][lag:], values[: len(T) - lag], rtol=0.0, atol=ROUNDING)


def test_an_output_that_feeds_itself_is_refused(packed):
    """The fixture signal_parameter_inline_with_mapping has this connection."""
    path, _ = packed("signal_parameter_inline_with_mapping", more=["step.y -> step.y"])
    with pytest.raises(SspError, match=r"connection step\.y -> step\.y: direction error") as refused:
        simulate(path, stop=1.0, step=H)
    assert [problem.rule.number for problem in refused.value.problems] == ["SSP031"]


@pytest.mark.parametrize("version", VERSIONS)
def test_the_motor_tends_to_the_exponential_with_the_square_of_the_step(pack, xml, blocks, version):
    """Of L I' = U - R I - k w and J w' = k I + M_load - d w; inline sets of version 2.0, as there, are refused."""
    ports = {"Machine": "U:input w:input M:output", "Mass": "M_A:input M_B:input wA:output",
             "Stimuli": "U:output M_load:output"}  # fmt: skip
    elements = [xml.component(unit.lower(), f"blocks/{unit}", text) for unit, text in ports.items()]
    wires = ["stimuli.U -> machine.U", "stimuli.M_load -> mass.M_B", "machine.M -> mass.M_A", "mass.wA -> machine.w",
             "machine.M -> M_mot", "M_load -> stimuli.M_load"]  # fmt: skip
    bindings = xml.values(xml.real("stimuli.height", 12.0, "V") + xml.real("stimuli.k", -0.5, "N.m"))
    options = {"extra": blocks(version), "connectors": "M_mot:output M_load:output"}
    path = pack(elements, wires, bindings=bindings, **options)
    R, L, k, J, d = 0.5, 1e-3, 0.1, 2e-3, 1e-3
    A = np.array([[-R / L, -k / L, 12.0 / L], [k / J, -d / J, -0.5 / J], [0.0, 0.0, 0.0]])
    errors = []
    for step in (2.0**-9, 2.0**-10):
        results = simulate(path, stop=0.25, step=step, algorithm="iterative")
        exact = np.array([(expm(A * time) @ [0.0, 0.0, 1.0])[:2] for time in results.time]).T
        errors.append(
            max(np.abs(results[name] - x).max() for name, x in zip(("machine.I", "mass.wA"), exact, strict=True))
        )
    # the fastest mode, 480 1/s, takes about two steps at first: the next order is a fifth of the error
    assert 3.2 < errors[0] / errors[1] < 4.8
    path = pack(elements, wires, bindings=bindings.replace('version="1.0"', 'version="2.0"'), **options)
    with pytest.raises(SspError, match="attribute 'version': .* The value '2.0' is not accepted") as refused:
        simulate(path, stop=1.0, step=H)
    assert [problem.rule.number for problem in refused.value.problems] == ["SSP003"]


def test_values_for_components_of_a_larger_system(pack, xml, blocks):
    """The set of the fixture scenario is bound twice, has a text, and is mapped to components that are not there."""
    mapping = "".join(
        f'<ssm:MappingEntry source="{a}" target="{b}"/>'
        for a, b in (("scenario_input", "scenario.word"), ("Mach_start", "ECS_HW.fd.Ma_start"))
    )
    binding = xml.values(
        '<ssv:Parameter name="scenario_input"><ssv:String value="gr&#252;n"/></ssv:Parameter>'
        + xml.real("Mach_start", 0.0) + xml.real("heat_load_start", 50.0),
        mapping=mapping,
    ).removeprefix("<ssd:ParameterBindings>").removesuffix("</ssd:ParameterBindings>")  # fmt: skip
    path = pack(
        ["scenario Counter word:parameter:String odd:output:Boolean"],
        bindings=f"<ssd:ParameterBindings>{binding}{binding}</ssd:ParameterBindings>",
    )
    with pytest.raises(SspError, match=r"'ECS_HW\.fd\.Ma_start'.* matches no element or connector") as refused:
        simulate(path, stop=1.0, step=0.25)
    assert {problem.rule.number for problem in refused.value.problems} == {"SSP052"}
    results = simulate(path, stop=1.0, step=0.25, ignore_unmatched=True)
    assert results["scenario.odd"][0]  # at the start, whether the word is gr\u00fcn


def test_a_table_feeds_a_gain(pack, xml, blocks, tmp_path):
    """The fixture pyfmu_csv_source_sink; its source is linear between the rows."""
    unit = table_unit({"time": [0.0, 0.5, 1.0], "y": [0.0, 1.0, -1.0]}, name="Source")
    source = build_fmus(None, tmp_path / "fmus", units=[unit])["source"].read_bytes()
    path = pack(
        ["source Source y:output:Real",
         xml.component("sink", "blocks/Gain", PORTS["Gain"])],
        ["source.y -> sink.u"], bindings=xml.values(xml.real("sink.k", 1.0)),
        extra={**blocks("2.0"), "resources/Source.fmu": source},
    )  # fmt: skip
    results = simulate(path, stop=1.0, step=H, algorithm="iterative")
    # numbers with few digits
    for signal in ("source.y", "sink.y"):
        np.testing.assert_array_equal(results[signal], np.interp(T, [0.0, 0.5, 1.0], [0.0, 1.0, -1.0]))


def test_a_mapped_parameter_of_a_reference_fmu(built, pack, xml):
    """VanDerPol, fast: mu = 2 from a mapped set; x0' = x1 and x1' = mu (1 - x0^2) x1 - x0 by Euler's method."""
    path = pack(
        [xml.component("fmu", "VanDerPol", "mu:parameter:Real x0:output:Real x1:output:Real")],
        bindings=xml.values(
            xml.real("mu", 2.0), mapping='<ssm:MappingEntry source="mu" target="fmu.mu"/>',
        ),
        extra={"resources/VanDerPol.fmu": built(models.VAN_DER_POL, "2.0")},
    )  # fmt: skip
    x, rows = np.array([2.0, 0.0]), []
    for _ in range(101):
        rows.append(x)
        x = x + 0.01 * np.array([x[1], 2.0 * (1.0 - x[0] ** 2) * x[1] - x[0]])
    results = simulate(path, stop=1.0, step=0.01)
    # the same operations, some in another order: 100 steps of some roundings each
    np.testing.assert_allclose(np.array([results["fmu.x0"], results["fmu.x1"]]).T, rows, rtol=0.0, atol=1e-13)
