"""The example of a plugin for MCAP: results of runs, and logs of ROS 2, as other tools read and write them."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosWriter
from rosbags.typesys import Stores, get_typestore

import vdfmu
from tests.added import installed
from tests.engine.files import assert_same_bits, hollow_results
from tests.extras.identify.recorded import M, T, motion
from vdfmu.base.errors import UsageError
from vdfmu.engine.run import Results
from vdfmu.extras.identify.log import read_log

EXAMPLE = Path(__file__).parents[3] / "examples" / "mcap"
NAMES = ("lift", "elbow")


@pytest.fixture(autouse=True)
def plugin(added: Callable[[Path], None], tmp_path_factory: pytest.TempPathFactory) -> None:
    """Add the example, with the entry points of its project."""
    folder = tmp_path_factory.mktemp("installed")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    installed(folder, project["name"], project["entry-points"])
    added(folder)
    added(EXAMPLE)


def test_numbers_of_all_kinds_or_none_read_back_to_the_same_bits(results, tmp_path):
    path = tmp_path / "r.mcap"
    results.write(path)
    again = Results.read(path)
    assert_same_bits(again, results)
    assert (again.signals, again.summary) == (results.signals, results.summary)
    text = path.read_bytes()
    results.write(path)
    assert path.read_bytes() == text and list(tmp_path.iterdir()) == [path]
    for some in hollow_results():
        some.write(tmp_path / "r.mcap")
        assert_same_bits(Results.read(tmp_path / "r.mcap"), some)


def test_other_readers_have_the_numbers_of_the_file(results, tmp_path):
    """The decoder of the MCAP project, and rosbags with definitions from the file, as Foxglove and PlotJuggler do."""
    path = tmp_path / "r.mcap"
    results.write(path)
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        kinds = [s.name for s in reader.get_summary().schemas.values()]
        assert kinds == [f"vdfmu/msg/{name}" for name in ("A", "B", "End", "B1", "B1X")]
        definition = next(s.data.decode() for s in reader.get_summary().schemas.values() if s.name == "vdfmu/msg/A")
        assert "float64[2] q  # rad, m\nint32[1] q_2  # \n" in definition
        decoded = [(m.log_time, d) for _, c, m, d in reader.iter_decoded_messages() if c.topic == "/a"]
    assert [stamp for stamp, _ in decoded[:3]] == [0, 1_000_000, 2_000_000]
    with AnyReader([path]) as reader:
        assert {c.topic for c in reader.connections} == {"/a", "/b", "/end", "/b_1", "/b1"}
        connections = [c for c in reader.connections if c.topic == "/a"]
        deserialized = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    for mine in ([d for _, d in decoded], deserialized):
        for name, column in (("q", [results["a.q[1]"], results["a.q[2]"]]), ("k_p", [results["a.K_p__"]])):
            np.testing.assert_array_equal(np.array([getattr(d, name) for d in mine]).T, column)
        np.testing.assert_array_equal([d.time for d in mine], results.time)
        np.testing.assert_array_equal([bool(d.on[0]) for d in mine], results["a.on"])


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")


@pytest.fixture(scope="module")
def data(robot):
    return motion(robot, T)


def same(log, data):
    for mine, other in zip((log.kappa, log.q, log.tau), data, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-14, atol=1e-14)  # a factor that is taken off again
    np.testing.assert_allclose(log.t - log.t[0], T, atol=1e-9)  # stamps are whole nanoseconds


@pytest.fixture(scope="module")
def bag(data, tmp_path_factory):
    """Return an MCAP file by rosbags: JointState with joints in an order that changes, and links on another topic."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    State, Header, Time = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    kappa, q, tau = data
    effort = tau * vdfmu.load_robot("planar_2dof").ell
    folder = tmp_path_factory.mktemp("bag") / "bag"
    with RosWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, positions, late in (("/joint_states", kappa, 0), ("/links", q, 0)):
            connection = writer.add_connection(topic, State.__msgtype__, typestore=store)
            for k in range(M):
                order = [0, 1] if k % 3 else [1, 0]
                stamp = 1_700_000_000_000_000_000 + round(T[k] * 1e9) + late
                header = Header(Time(*divmod(stamp, 10**9)), "")
                names, none = [NAMES[i] for i in order], np.zeros(0)
                efforts = effort[k, order] if topic == "/joint_states" else none
                message = State(header, names, positions[k, order], none, efforts)
                writer.write(connection, stamp + 3_000_000, store.serialize_cdr(message, State.__msgtype__))
    return next(folder.glob("*.mcap"))


def test_joint_states_of_ros(robot, data, bag):
    named = robot.__class__(**{**robot.__dict__, "joint_names": NAMES})
    log = read_log(bag, named, {"q": "/links.position[{}]"})
    same(log, data)
    assert log.notes[0].startswith("kappa is /joint_states.position[lift] and so on, which in ROS ")
    assert log.notes[1].startswith("tau_link is /joint_states.effort[lift]") and len(log.notes) == 2
    with pytest.raises(UsageError, match=r"there are .*/joint_states.position\[lift\]"):
        read_log(bag, robot)
