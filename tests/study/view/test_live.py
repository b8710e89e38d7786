"""A run with a live view: the same run, whatever becomes of the view."""

import base64
import http.client
import socket
import sys
import time
import urllib.request
from contextlib import nullcontext

import numpy as np
import pytest
import typer
import viser
import websockets.asyncio.server
from typer.testing import CliRunner
from vdfmu.study.view.scene import ArmScene, open_server, stage

import vdfmu
from vdfmu.base.bars import Bars, errors
from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.cli.commands import app
from vdfmu.cli.terminal import console
from vdfmu.cli.view import live_view
from vdfmu.study.report.content import arm_of
from vdfmu.study.report.shapes import Chain
from vdfmu.study.view.live import HEAD, LiveView
from vdfmu.study.view.live_server import ViewServer

NAMES = [f"{name}[{i}]" for name in ("plant.q", "trajectory.q_d", "controller.tau", "plant.kappa") for i in (1, 2)]


@pytest.mark.heavy
def test_a_run_with_a_view_is_the_run_without_and_outlives_it(tmp_path):
    said = []
    with LiveView(say=said.append) as live:
        assert said == [f"Live view: {live.address}"]
        assert live.address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(live.address) as page:
            assert page.status == 200
        shown = vdfmu.run("planar_tracking", stop=0.3, reference=False, out=tmp_path, observer=live)
        assert live.open
        live.stay()  # returns: there is neither a terminal nor a browser
        live._child.kill()
        while live.open:
            time.sleep(0.01)
        alone = vdfmu.simulate(tmp_path / "system.ssp", stop=0.3, observer=live)
        assert not live.open
        live.stay()
        assert said.pop() == "note: live view: it has ended: it was killed"
    plain = vdfmu.simulate(tmp_path / "system.ssp", stop=0.3)
    for name in plain:
        np.testing.assert_array_equal(shown[name], plain[name])
        np.testing.assert_array_equal(alone[name], plain[name])
    assert len(said) == 2  # system.ssp does not say whose arm it is


@pytest.fixture
def server():
    one = open_server(None, "test")
    yield one
    one.stop()


LOOPBACK, PAGE = "127.0.0.1:{port}", "http://127.0.0.1:{port}"


@pytest.mark.parametrize(
    ("path", "host", "origin", "code"),
    [
        ("/{token}/", LOOPBACK, None, 200),
        ("/{token}", "localhost:{port}", PAGE.replace("127.0.0.1", "localhost"), 200),
        ("/{token}/", "[::1]:1", "http://[::1]:1", 200),  # the other end of a tunnel
        ("/{token}/index.html?x=1", LOOPBACK, PAGE, 200),
        ("/", LOOPBACK, None, 403),
        ("/index.html", LOOPBACK, None, 403),
        ("/{token}x/", LOOPBACK, None, 403),
        ("/%7btoken%7d/", LOOPBACK, None, 403),
        ("//{token}/", LOOPBACK, None, 403),
        ("/{token}/", "evil.example:{port}", None, 403),
        ("/{token}/", "127.0.0.1.evil.example:{port}", None, 403),
        ("/{token}/", "evil.example@127.0.0.1.evil.example", None, 403),
        ("/{token}/", "[", None, 403),
        ("/{token}/", LOOPBACK, "http://evil.example", 403),
        ("/{token}/", LOOPBACK, "http://127.0.0.1:1", 403),
        ("/{token}/", LOOPBACK, "null", 403),
        ("/{token}/", LOOPBACK, PAGE.replace("http", "https"), 403),
    ],
)
def test_a_view_answers_its_own_page_only(server, path, host, origin, code):
    """By HTTP, and by the websocket that would read the scene and send events of the panel."""
    words = {"port": server.get_port(), "token": server.token}
    headers = {"Host": host.format(**words), **({"Origin": origin.format(**words)} if origin else {})}
    client = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
    client.request("GET", path.format(**words), headers=headers)
    assert client.getresponse().status == code
    client.close()
    upgrade = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": base64.b64encode(bytes(16)).decode(),
        "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
    }  # fmt: skip
    client.request("GET", path.format(**words), headers=headers | upgrade)
    assert client.getresponse().status == (101 if code == 200 else code)
    client.close()


def test_two_views_have_two_tokens_and_other_servers_of_the_process_none(server):
    other = open_server(None, "test")
    other.stop()
    assert server.token != other.token
    assert len(server.token) >= 22  # 16 bytes in base 64
    assert websockets.asyncio.server.serve.__module__ == "websockets.asyncio.server"


def test_a_viser_that_cannot_be_guarded_is_refused(monkeypatch):
    monkeypatch.setattr("vdfmu.study.view.guard.Guard.placed_before", lambda *_: nullcontext())
    with pytest.raises(VdfmuError, match=r"viser .* lets any page in the browser see the view"):
        open_server(None, "test")


def test_what_is_shown_is_the_row_and_afterwards_any_of_the_run():
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {})
    server = open_server(None, "test")
    try:
        drawer, sent = ViewServer(server), []
        live = LiveView.__new__(LiveView)
        live._arm, live._speed, live._say, live._folder = None, None, sent.append, None
        live._send = lambda name, *arguments: getattr(drawer, name)(*arguments)
        live.begin(NAMES, {"arm": arm, "scenario": "test", "start": 0.0, "stop": 2.0})
        values = np.array([0.3, -0.4, 0.31, -0.41, 0.02, 0.01, 0.302, -0.401])
        live.row(1.0, values)
        drawer.step()
        scene, chain = drawer._scene, Chain(arm)
        assert scene is not None
        for handle, (R, p) in zip(scene._arm._links, chain.placements(values[:2]), strict=True):
            assert handle.position == pytest.approx(tuple(p))
            w, x, y, z = handle.wxyz
            assert R[1, 0] == pytest.approx(2.0 * (x * y + w * z))  # of a quaternion to a matrix
        shown = scene.values({"q": values[:2], "q_d": values[2:4], "tau": values[4:6], "kappa": values[6:]})
        np.testing.assert_allclose(shown["error"], [0.01, -0.01])
        np.testing.assert_allclose(shown["torque"], [2.0, 1.0])  # ell is 100
        np.testing.assert_allclose(shown["torsion"], [0.002, -0.001])
        assert "t = 1.000 s, 50 %" in scene._state.content
        assert "| 17.19 |" in scene._numbers.content  # degrees
        time = np.array([0.0, 1.0, 2.0])
        drawer.end(
            time,
            {key: np.outer(time, values[i : i + 2]) for key, i in (("q", 0), ("q_d", 2), ("tau", 4), ("kappa", 6))},
        )
        scene.slider.value = 1.2
        drawer.step()
        assert scene._arm._links[1].wxyz == pytest.approx([np.cos(-0.2), 0.0, 0.0, np.sin(-0.2)])
        assert sent == []
    finally:
        server.stop()


def test_a_torn_row_is_not_drawn():
    server = ViewServer(None)
    server._words, server._places = np.array([3.0, 0.1, 1.0]), {"q": [0]}
    assert server._row() is None  # it is being written
    server._words[0] = 4.0
    assert server._row() == (0.1, {"q": np.array([1.0])})
    assert server._row() is None  # and shown already
    assert HEAD == 2


@pytest.mark.parametrize(
    ("names", "about", "why"),
    [
        (NAMES, {}, "no robot is known"),
        (["spring.x"], {"arm": 1}, "there is no signal plant.q of its joints"),
        (NAMES[:1], {"arm": 1}, "there is no signal plant.q of its joints"),
    ],
)
def test_where_there_is_no_arm_to_show_it_says_so_once(names, about, why):
    live, said, sent = LiveView.__new__(LiveView), [], []
    live._arm, live._say, live._send = (None, said.append, lambda *message: sent.append(message))
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {})
    live.begin(names, {name: arm for name in about} | {"system": "springs", "start": 0.0, "stop": 1.0})
    live.row(0.0, np.zeros(len(names)))
    assert len(said) == len(sent) == 1
    assert why in said[0]
    assert sent[0][:2] == ("words", "springs")


def test_what_is_wrong_is_said_before_the_run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=f"port {port}: expected a free port of 127.0.0.1, got: .* in use"):
            open_server(port, "test")
    for words in ("run tracking --port 8000", "simulate x.ssp --robot planar_2dof"):
        done = CliRunner().invoke(app, words.split())
        assert isinstance(done.exception, UsageError)
        assert "expected --live" in str(done.exception)
    monkeypatch.setitem(sys.modules, "viser", None)
    for words in ("run tracking --live", "view planar_2dof"):
        done = CliRunner().invoke(app, words.split())
        assert isinstance(done.exception, UsageError)
        assert "'pip install vdfmu[view]'" in str(done.exception)
    assert list(tmp_path.iterdir()) == []


def test_quiet_leaves_the_address_of_a_view_and_bars_end_before_it_waits(monkeypatch, capsys):
    seen = []

    class View:
        def __init__(self, say, **_):
            self.say = say

        def __enter__(self):
            self.say("Live view: http://127.0.0.1:1")
            return self

        def __exit__(self, *_):
            pass

        def stay(self):
            seen.append(console.bars)
            self.say("note: a note")

    monkeypatch.setattr("vdfmu.study.view.live.LiveView", View)
    monkeypatch.setattr(errors, "quiet", True)
    monkeypatch.setattr(console, "bars", Bars("run"))
    with live_view(True, None, None):
        pass
    with pytest.raises(typer.Exit) as end, live_view(True, None, None):
        raise CosimError("plant", "fmi2DoStep", 0.5, "it failed")
    assert end.value.exit_code == 1
    assert seen == [None, None]
    output = capsys.readouterr()
    assert output.out.splitlines() == ["Live view: http://127.0.0.1:1"] * 2
    assert output.err.startswith("error: plant")


def test_the_foot_of_an_arm_that_hangs_is_above_it():
    for name, sign in (("snake_24dof", 1.0), ("planar_2dof", -1.0)):
        chain, server = Chain(arm_of(vdfmu.load_robot(name), {})), open_server(None, "test")
        try:
            stage(server, chain, chain.points(np.zeros(chain.n)))
            foot = server.scene._handle_from_node_name["/foot"]
            assert np.sign(np.dot(foot.position, chain.up)) == sign
        finally:
            server.stop()


def test_all_meshes_that_cannot_be_shown_are_named(tmp_path):
    robot = vdfmu.load_robot("planar_2dof")
    look = {"shape": "mesh", "size": [1, 1, 1], "color": [1, 1, 1, 1], "offset": [0, 0, 0], "rotation": np.eye(3)}
    shapes = [look | {"joint": i, "file": f"mesh_{i}.stl"} for i in (1, 2)]
    server = open_server(None, "test")
    try:
        notes = ArmScene(server, Chain(arm_of(robot, {})), visuals=shapes, folder=tmp_path).notes
    finally:
        server.stop()
    assert [note.partition(" cannot")[0] for note in notes] == ["mesh mesh_1.stl", "mesh mesh_2.stl"]
