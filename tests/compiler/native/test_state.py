"""Saved states: every run continues to the bit, in another instance and process too; many runs leave nothing."""

import ctypes as ct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.compiler.conftest import EACH
from tests.compiler.native.binding import ERROR, Instance, same_bits
from tests.compiler.native.driven import drive
from vdfmu.arm.units import shipped_units

Native = Callable[..., Instance]
H = 1e-3
KINDS = ("CoSimulation", "ModelExchange")
FORMS = [("2.0", KINDS[0]), ("2.0", KINDS[1]), ("3.0", KINDS[0]), ("3.0", KINDS[1]), ("python", KINDS[0])]
EACH_KIND = pytest.mark.parametrize(("version", "kind"), FORMS)
OTHER_UNITS = [unit for unit in shipped_units() if unit != "plant"]


def started(native: Native, kind: str, version: str, unit: str = "plant", **options: Any) -> Instance:
    values = {"q_0": [0.3, -0.2], "q_dot_0": [0.2, 0.1]} if unit == "plant" else {}
    instance = native(unit, version, kind=kind, **options).start(**values)
    if kind == "ModelExchange":
        instance.continuous()
    drive(instance, 0, 5)
    return instance


@pytest.mark.parametrize(
    ("unit_name", "version", "kind"),
    [("plant", *form) for form in FORMS]
    + [(unit, form, KINDS[0]) for unit in OTHER_UNITS for form in ("2.0", "python")],
)
def test_a_restored_or_serialized_state_continues_to_the_bit(native, version, kind, unit_name):
    unit = started(native, kind, version, unit_name)
    state, time, data = unit.save(), unit.time, unit.complete()
    first = drive(unit, 5, 20)
    for _ in range(3):
        unit.restore(state)
        assert unit.complete() == data
        unit.time = time
        assert same_bits(drive(unit, 5, 20), first)
    unit.forget(state)
    if version != "python":  # pythonfmu's library leaves the pointer
        assert state.value is None
        unit.forget(state)  # freeing nothing is allowed
    assert len(np.unique(first, axis=0)) > (19 if unit_name == "plant" else 2)
    other = native(unit_name, version, kind=kind, name="other")
    other.restore(other.deserialize(data))
    other.time = time
    assert other.complete() == data
    assert same_bits(drive(other, 5, 20), first)


@EACH
def test_a_rollback_near_standstill_restores_the_solver_and_its_tolerance(native, version):
    """The step that the solver tries next decides the bits of what follows, and so does the tolerance."""
    unit = native("plant", version).start(q_0=[0.3, -0.2], q_dot_0=[0.02, -0.01])
    unit.set(tau=unit.get("tau_s") / unit.get("ell"))  # holds the weight, so that friction stops the rotors
    for _ in range(30):
        unit.step(H)
    assert 0.0 < np.abs(unit.get("kappa_dot")).max() < 1e-3  # below eps: the steepest part of tanh(v/eps)
    state, time = unit.save(), unit.time
    x = {f"{name}_0": unit.get(name) for name in ("q", "q_dot", "kappa_dot", "tau_s")}
    first = drive(unit, 0, 10)
    unit.restore(state).time = time
    assert same_bits(drive(unit, 0, 10), first)
    # The same physical state under a solver that starts anew differs, within the tolerance of 1e-7 a step.
    fresh = drive(native("plant", version).start(time, equilibrium=False, **x), 0, 10)
    assert not same_bits(fresh, first)
    assert np.abs(fresh - first)[:, :4].max() < 1e-5  # q, q_dot; 10 communication steps of some internal ones
    fine, coarse = (native("plant", version).start(tolerance=t, q_0=[0.3, 0.0]) for t in (1e-10, 1e-3))
    data = fine.complete()
    fine_run = drive(fine, 0, 5)
    assert not same_bits(drive(coarse, 0, 5), fine_run)
    coarse.restore(coarse.deserialize(data)).time = 0.0
    assert same_bits(drive(coarse, 0, 5), fine_run)


def test_a_state_that_is_got_again_is_overwritten(native, version):
    """FMI: a pointer that is not null is one of this instance, whose memory is used again."""
    unit = started(native, "CoSimulation", version)
    pointer = unit.save()
    place = pointer.value
    drive(unit, 5, 5)
    now = unit.complete()
    unit.do(f"Get{unit._state}", ct.byref(pointer))
    assert pointer.value == place
    assert unit.serialize(pointer) == now


CONTINUE = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from tests.compiler.native.binding import Instance, Model
instance = Instance(Model(Path(sys.argv[2])), kind=sys.argv[4], name="moved")
instance.restore(instance.deserialize(Path(sys.argv[3]).read_bytes()))
instance.time = float.fromhex(sys.argv[5])
from tests.compiler.native.driven import drive
for row in drive(instance, 5, 20):
    print(*(value.hex() for value in row.tolist()))
instance.free()
"""


@pytest.mark.few(1)
@EACH_KIND
def test_a_serialized_state_continues_in_another_process_to_the_bit(
    native, version, kind, run_python, tmp_path, pytestconfig
):
    unit = started(native, kind, version)
    (tmp_path / "state").write_bytes(unit.complete())
    root = pytestconfig.rootpath
    text = run_python(CONTINUE, root, unit.model.folder, tmp_path / "state", kind, unit.time.hex())
    there = [[float.fromhex(word) for word in line.split()] for line in text.splitlines()]
    assert same_bits(there, drive(unit, 5, 20))


@pytest.mark.parametrize("name", ["plant", "controller"])
@EACH
def test_states_of_every_phase_can_be_saved_and_restored(native, version, name):
    """Each keeps what is allowed in its phase."""
    unit = native(name, version)
    states = {"instantiated": unit.save()}
    unit.setup().enter()
    states["initialization"] = unit.save()
    unit.do("ExitInitializationMode")
    states["step"] = unit.save()
    unit.step().do("Terminate")
    states["terminated"] = unit.save()
    for pointer in states.values():  # through bytes, too
        unit.restore(unit.deserialize(unit.serialize(pointer)))
    unit.restore(states["instantiated"]).setup().enter()
    unit.restore(states["initialization"]).do("ExitInitializationMode").step()
    unit.restore(states["terminated"])
    with unit.refuses("it is allowed only") as no:
        no("DoStep", *unit.step_arguments(H, H))
    unit.restore(states["step"])
    unit.time = 0.0
    unit.step()


def variants(data: bytes) -> Iterator[tuple[str, bytes]]:
    for cut in (0, 1, 7, 8, 27, 28, 60, len(data) // 2, len(data) - 8, len(data) - 1):
        yield f"{cut} bytes", data[:cut]
    yield "one more byte", data + b"\0"
    rng = np.random.default_rng(4)
    for place in (*range(90), *rng.integers(90, len(data), 200).tolist()):
        for bit in (1, 128):
            yield f"bit of byte {place}", data[:place] + bytes([data[place] ^ bit]) + data[place + 1 :]
    yield "zeros", bytes(len(data))
    yield "ones", b"\xff" * len(data)


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_state_is_refused_and_changes_nothing(native, version, kind):
    unit = started(native, kind, version)
    data = unit.complete()
    pointer = ct.c_void_p()
    for damage, damaged in variants(data):
        count = len(unit.messages)
        status = unit.call(unit.deserialize_name, damaged, len(damaged), ct.byref(pointer))
        assert (status, pointer.value) == (ERROR, None), damage
        assert len(unit.messages) == count + 1
        assert "failed: " in unit.messages[-1].text
    assert unit.complete() == data


def checksum(data: bytes) -> bytes:
    """FNV-1a, as the unit has it at the end."""
    total = 14695981039346656037
    for byte in data:
        total = (total ^ byte) * 1099511628211 % 2**64
    return total.to_bytes(8, "little")


@pytest.mark.heavy
@pytest.mark.parametrize("kind", KINDS)
def test_a_forged_state_is_refused_where_no_unit_can_be(native, version, kind):
    """With a right checksum: whatever 4 or 8 bytes are replaced, the state is refused, or is one that can be used."""
    unit = started(native, kind, version)
    before = unit.complete()
    refused = 0
    # pieces of header and core: numbers of 4 bytes first, then every double
    for place in (*range(8, 28, 4), *range(28, len(before) - 16, 4)):
        for piece in (b"\xff\xff\xff\xff", b"\0\0\xf0\x7f", b"\x07\0\0\0", b"\0\0\0\x80"):
            forged = before[:place] + piece + before[place + 4 : -8]
            forged += checksum(forged)
            pointer = ct.c_void_p()
            if unit.call(unit.deserialize_name, forged, len(forged), ct.byref(pointer)) == ERROR:
                refused += 1
                continue
            unit.restore(pointer).forget(pointer)  # and if it is none: the instance still answers
            for group in ("q", "mass", "tau"):
                unit.call(f"Get{unit._type('Real')}", *unit._values(unit.model.group(group), unit._room("Real", 2)))
            unit.restore(back := unit.deserialize(before)).forget(back)
    assert refused > 100
    assert unit.complete() == before
    assert all(m.text.isprintable() for m in unit.messages)
    assert not any("\ufffd" in m.text for m in unit.messages)


def test_a_state_of_another_kind_of_instance_unit_or_robot_is_refused(native, version):
    unit = started(native, "CoSimulation", version)
    pointer = ct.c_void_p()
    cases = [
        (
            native("plant", version, kind="ModelExchange"),
            "for co-simulation, got one of an instance for model exchange",
        ),
        (native("controller", version), r"expected a state of Plant with GUID \{.*got one with GUID \{"),
        (
            native("plant", "3.0" if version == "2.0" else "2.0"),
            r"expected a state of Plant with GUID \{.*got one with GUID",
        ),
    ]
    before = unit.complete()
    for other, words in cases:
        data = other.complete()
        with unit.refuses(words) as no:
            no(unit.deserialize_name, data, len(data), ct.byref(pointer))
    assert pointer.value is None
    assert unit.complete() == before


def test_a_pointer_that_is_no_state_of_the_instance_and_room_of_the_wrong_size_are_refused(native, version):
    unit, other = (started(native, "CoSimulation", version) for _ in range(2))
    foreign, freed, size = other.save(), unit.save(), ct.c_size_t()
    gone = ct.c_void_p(freed.value)
    unit.forget(freed)
    room = (ct.c_ubyte * 8)()
    before = unit.complete()
    wrong = {"another pointer": (foreign, gone, ct.c_void_p(1)), "a null pointer": (ct.c_void_p(),)}
    for pointer, got in ((pointer, got) for got, pointers in wrong.items() for pointer in pointers):
        words = rf"expected a saved state of this instance, got {got}\."
        with unit.refuses(words) as no:
            no(f"Set{unit._state}", pointer)
            no(f"Serialized{unit._state}Size", pointer, ct.byref(size))
            no(f"Serialize{unit._state}", pointer, room, len(room))
            if pointer.value:
                no(f"Free{unit._state}", ct.byref(pointer))
                no(f"Get{unit._state}", ct.byref(pointer))
    assert unit.complete() == before
    other.forget(foreign)
    unit = started(native, "CoSimulation", version)
    pointer = unit.save()
    whole = len(unit.serialize(pointer))
    for size in (0, 1, whole - 1, whole + 1):
        room = (ct.c_ubyte * (whole + 1))()
        with unit.refuses(rf"expected room for {whole} bytes, got {size}\.") as no:
            no(f"Serialize{unit._state}", pointer, room, size)
        assert not any(room)


@pytest.mark.few(15)
@pytest.mark.parametrize("phase", ["instantiated", "initialization", "step", "terminated"])
@EACH
def test_after_reset_an_instance_is_a_new_one(native, version, unit_name, phase):
    unit, fresh = native(unit_name, version), native(unit_name, version)
    gain = {"plant": "mass", "controller": "K_p", "feedforward": "Lambda", "trajectory": "q_end", "estimator": "K_f0"}[
        unit_name
    ]
    if phase != "instantiated":
        unit.setup(5.0, 1e-3).set(**{gain: 2.0}).enter()
    if phase in ("step", "terminated"):
        drive(unit.do("ExitInitializationMode"), 0, 5)
    if phase == "terminated":
        unit.do("Terminate")
    unit.do("Reset")
    assert unit.complete() == fresh.complete()
    assert same_bits(drive(unit.start(), 0, 5), drive(fresh.start(), 0, 5))


MANY = """
import ctypes, gc, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from tests.compiler.native.binding import Instance, Model
models = [Model(Path(folder)) for folder in sys.argv[3:]]

class Info(ctypes.Structure):
    _fields_ = [(f"field_{k}", ctypes.c_size_t) for k in range(10)]

mallinfo = ctypes.CDLL(None).mallinfo2
mallinfo.restype = Info

def memory():
    gc.collect()  # instances and their callbacks hold each other
    info = mallinfo()
    return info.field_7 + info.field_4  # bytes in use: uordblks, and hblkhd of large blocks

def use(count):
    for k in range(count):
        instance = Instance(models[k % len(models)], kind=("CoSimulation", "ModelExchange")[k // 2 % 2])
        instance.start()
        if instance.kind == "CoSimulation":
            instance.step()
        instance.save()
        instance.save()  # freed with the instance
        instance.free()

use(400)
for _ in range(4):
    before = memory()
    use(int(sys.argv[2]))
    print(memory() - before)
"""


def test_two_thousand_instances_leave_no_memory_behind(model, run_python, pytestconfig):
    """Blocks of malloc that are in use are counted: Python has those of less than 512 bytes elsewhere."""
    # The least of four rounds counts. What instances leave behind is in each; a table of Python's own that it doubles
    # is in one, such as that of interned strings in Python 3.13, 540 kB. glibc's smallest block has 32 bytes: less
    # than a byte an instance is less than one block of one in 32.
    count = 500
    folders = [model("plant", version).folder for version in ("2.0", "3.0")]
    grown = run_python(MANY, pytestconfig.rootpath, count, *folders).split()
    assert len(grown) == 4 and min(map(int, grown)) < count
