"""What is wrong with a split is said before anything runs; the sockets of a run are on loopback."""

import re
import sys
from pathlib import Path

import pytest

import vdfmu
from tests.engine.reference import models
from vdfmu.base.errors import UsageError, VdfmuError


@pytest.fixture
def package(pack):
    return pack(
        ["r Ramp y:output", "a Adder a:input b:input y:output", "plant Plant u:input y:output"],
        ["r.y -> a.a", "plant.y -> a.b", "a.y -> plant.u"],
    )


@pytest.mark.parametrize(("options", "message"), [
    ({"split": ["plan"]}, "split: the system has no component 'plan'; did you mean plant"),
    ({"split": ["a", "plant,a"]}, "split: a is named twice, for the federates a and plant"),
    ({"split": ["a,a"]}, "split: a is named twice"),
    ({"split": ["r,a,plant"]}, "split: expected at least two federates, got r; name some of the components r, a"),
    ({"split": []}, "split: expected at least two federates, got r"),
    ({"split": ["a"], "only": "plant", "broker": "x:1"}, "no federate is named 'plant'; expected a, r"),
    ({"split": ["a"], "only": "a"}, "federate a runs alone, and needs the address of a broker"),
    ({"split": ["a"], "core": "pigeon"}, "core: expected tcp_ss, tcp, zmq, ipc, got 'pigeon'"),
    ({"split": ["a"], "algorithm": "gauss-seidel"}, "algorithm must be jacobi for federates, got gauss-seidel"),
])  # fmt: skip
def test_a_wrong_split_is_a_usage_error(package, federates, options, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        vdfmu.federate(package, step=0.1, **options)


def test_all_faults_of_a_split_are_said_at_once_and_without_helics_how_to_get_it(package, monkeypatch):
    with pytest.raises(UsageError, match=r"(?s)'x'.*named twice.*core"):
        vdfmu.federate(package, ["x", "a", "a"], core="", step=0.1)
    monkeypatch.setitem(sys.modules, "helics", None)
    with pytest.raises(VdfmuError, match="package helics, but .* Install it: .* -m pip install helics"):
        vdfmu.federate(package, ["a"], step=0.1)


def test_components_with_event_mode_are_refused(system):
    path = system({"s": (models.STAIR, "3.0"), "c": (models.FEEDTHROUGH_2, "2.0")}, ["s.counter -> c.Int32_input"])
    with pytest.raises(UsageError, match="s: has event mode, .*'vdfmu run' runs it"):
        vdfmu.federate(path, ["s"], stop=1.0, step=0.1)


@pytest.mark.heavy
@pytest.mark.parametrize("core", ["tcp_ss", "tcp", "zmq"])
def test_nothing_listens_but_on_loopback(package, federates, core):
    """The sockets of the federates' processes, by their inodes, while they run."""
    addresses: list[str] = []

    def look(k: int, n: int) -> None:
        inodes = {
            link.readlink().name for process in federates().values() for link in Path(f"/proc/{process}/fd").iterdir()
        }
        for family in ("tcp", "tcp6"):
            for line in Path(f"/proc/net/{family}").read_text().splitlines()[1:]:
                _, local, _, state, *rest = line.split()
                if state == "0A" and f"socket:[{rest[5]}]" in inodes:  # it listens
                    addresses.append(local.partition(":")[0])

    vdfmu.federate(package, ["a"], core=core, step=0.25, progress=look)
    assert set(addresses) == {"0100007F"}  # 127.0.0.1
