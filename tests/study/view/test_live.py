"""A run with a live view: the same run, whatever becomes of the view."""

import http.client
import json
import re
import socket
import sys
import time
import urllib.request
from queue import Empty

import numpy as np
import pytest

import vdfmu
from tests.conftest import invoked, refused
from vdfmu.base.bars import Bars, errors
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.cli.terminal import console
from vdfmu.cli.view import live_view
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report.shapes import mesh_parts
from vdfmu.study.run.scene import arm_of
from vdfmu.study.view.live import HEAD, LiveView
from vdfmu.study.view.live_server import ViewServer
from vdfmu.study.view.robot import RobotView
from vdfmu.study.view.server import PageServer

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
def taken():
    return []


@pytest.fixture
def server(taken):
    page_server = PageServer(take=taken.append)
    page_server.show(b"<html><head></head>the page</html>")
    yield page_server
    page_server.close()


LOOPBACK, PAGE = "127.0.0.1:{port}", "http://127.0.0.1:{port}"


@pytest.mark.parametrize(("path", "host", "origin", "code"), [
    ("/{token}/", LOOPBACK, None, 200),
    ("/{token}", "localhost:{port}", PAGE.replace("127.0.0.1", "localhost"), 200),
    ("/{token}/", "[::1]:1", "http://[::1]:1", 200),  # the other end of a tunnel
    ("/{token}/index.html?x=1", LOOPBACK, PAGE, 200),
    ("/", LOOPBACK, None, 403),
    ("/index.html", LOOPBACK, None, 403),
    ("/{token}x/", LOOPBACK, None, 403),
    ("/%7btoken%7d/", LOOPBACK, None, 403),
    ("/{token}/", "evil.example:{port}", None, 403),
    ("/{token}/", "127.0.0.1.evil.example:{port}", None, 403),
    ("/{token}/", "evil.example@127.0.0.1.evil.example", None, 403),
    ("/{token}/", "[", None, 403),
    ("/{token}/", LOOPBACK, "http://evil.example", 403),
    ("/{token}/", LOOPBACK, "http://127.0.0.1:1", 403),
    ("/{token}/", LOOPBACK, "null", 403),
    ("/{token}/", LOOPBACK, PAGE.replace("http", "https"), 403),
])  # fmt: skip
def test_a_view_answers_its_own_page_only(server, taken, path, host, origin, code):
    """The page, the events, and requests of the page."""
    words = {"port": server.port, "token": server.token}
    headers = {"Host": host.format(**words), **({"Origin": origin.format(**words)} if origin else {})}
    events = f"{path.partition('?')[0].removesuffix('index.html').rstrip('/')}/events"
    for method, place, done in (("GET", path, 200), ("GET", events, 200), ("POST", path, 204)):
        client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        client.request(method, place.format(**words), b"{}" if method == "POST" else None, headers)
        assert client.getresponse().status == (done if code == 200 else code)
        client.close()
    assert taken == ([{}] if code == 200 else [])


def asked(server, body, **headers):
    client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    client.request("POST", f"/{server.token}/ask", body, headers)
    status = client.getresponse().status
    client.close()
    return status


@pytest.mark.parametrize("body", [b"", b"{", b"[1]", b" " * 70_000 + b"{}", b"[" * 60_000])
def test_what_is_no_request_of_a_page_is_refused(server, taken, body, capfd):
    assert asked(server, body) == 400
    assert taken == []
    assert capfd.readouterr().err == ""  # no traceback


@pytest.mark.parametrize("length", ["-5", "\xb2", "9" * 5000])  # Python reads integers of at most 4300 digits
def test_a_length_that_is_none_is_refused(server, length, capfd):
    assert asked(server, b"{}", **{"Content-Length": length}) == 400
    assert capfd.readouterr().err == ""


def test_two_views_have_two_tokens(server):
    other = PageServer()
    other.close()
    assert server.token != other.token
    assert len(server.token) >= 22  # 16 bytes in base 64


class Page:
    """A page that hears events."""

    def __init__(self, server, number):
        self.client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        self.client.request("GET", f"/{server.token}/events?page={number}")
        self.answer = self.client.getresponse()

    def next(self):
        """Return the next event, None at the end."""
        while True:
            line = self.answer.readline()
            if not line or line.startswith(b"data: "):
                return json.loads(line[6:]) if line else None

    def close(self):
        """Close the page."""
        self.answer.close()
        self.client.close()


def test_pages_hear_how_things_are_and_then_what_happens(server):
    server.show(b"<head></head>", "words", first=lambda: {"rows": [1]})
    with urllib.request.urlopen(server.address) as answer:
        assert answer.read() == b'<head><meta name="live" content="2" data-words="words"></head>'
    pages = [Page(server, 2), Page(server, 2)]
    assert [page.next() for page in pages] == [{"rows": [1]}] * 2
    assert server.clients == 2
    old = Page(server, 1)  # it was opened before the page changed
    assert old.next() == {"page": 2}
    for page in (old, pages[0]):
        page.close()
    server.send(lambda: {"rows": [2]})
    assert pages[1].next() == {"rows": [2]}
    ends = time.monotonic() + 20.0
    while server.clients > 1:  # a line a second finds out who is gone
        assert time.monotonic() < ends
        time.sleep(0.05)
    server.show(b"<head></head>")
    assert pages[1].next() == {"page": 3}
    pages[1].close()


def test_a_browser_that_is_too_slow_is_cut_off_and_no_other_waits(server):
    slow = server.hear("1")
    for k in range(1500):
        server.send(lambda k=k: {"rows": [k]})
    assert server.clients == 0
    events = []
    with pytest.raises(Empty):
        while True:
            events.append(slow.get_nowait())
    assert events[-1] is None  # its connection ends, and it comes back
    assert len(events) == 1000


def test_what_is_shown_are_the_rows_and_afterwards_the_run():
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {})
    server = PageServer()
    try:
        drawer, sent = ViewServer(server), []
        live = LiveView.__new__(LiveView)
        live._arm, live._say, live._folder = None, sent.append, None
        live._send = lambda name, *arguments: getattr(drawer, name)(*arguments)
        live.begin(NAMES, {"arm": arm, "scenario": "test", "start": 0.0, "stop": 2.0})
        data = json.loads(server.content.decode().split('type="application/json">')[1].split("</script>")[0])
        assert data["live"] == {"names": NAMES, "start": 0.0, "stop": 2.0}
        recipes = {key: each[0] for key, each in data["runs"][0]["frames"]["recipes"].items()}
        assert recipes["error"] == [1.0, [[1.0, "trajectory.q_d[1]"], [-1.0, "plant.q[1]"]]]
        assert recipes["torque"] == [1.0, [[100.0, "controller.tau[1]"]]]  # ell is 100
        values = np.array([0.3, -0.4, 0.31, -0.41, 0.02, 0.01, 0.302, -0.401])
        pages = server.hear("2"), server.hear("2")
        live.row(1.0, values)
        drawer.step()
        drawer.step()  # nothing new
        for page in pages:
            assert page.get_nowait() == b'data: {"rows": [], "anew": true}\n\n'
            assert json.loads(page.get_nowait()[6:]) == {"rows": [[1.0, *values]]}
            assert page.empty()
        late = server.hear("2")
        assert json.loads(late.get_nowait()[6:]) == {"rows": [[1.0, *values]], "anew": True}
        for k in range(2000):
            live.row(1.0 + k / 1000.0, values)
            drawer.step()
        last = server.hear("2")
        shown = json.loads(last.get_nowait()[6:])["rows"]
        assert 200 <= len(shown) <= 500
        assert np.ptp(np.diff([row[0] for row in shown[1:]])) < 1e-12  # at equal distances
        signals = [Signal(name, "real", "", k) for k, name in enumerate(NAMES)]
        live.end(Results(np.array([0.0, 1.0]), signals, {"real": np.array([0.0 * values, values])}))
        assert b'data-words="The run ended early: 0 to 1 s."' in server.content
        assert sent == []
    finally:
        server.close()


def test_a_torn_row_is_not_drawn():
    server = ViewServer(PageServer())
    server._words = np.array([3.0, 0.1, 1.0])
    assert server._row() is None  # it is being written
    server._words[0] = 4.0
    assert server._row() == [0.1, 1.0]
    assert server._row() is None  # and shown already
    assert HEAD == 2
    server._server.close()


@pytest.mark.parametrize(("names", "about", "why"), [
    (NAMES, {}, "no robot is known"),
    (["spring.x"], {"arm": 1}, "there is no signal plant.q of its joints"),
    (NAMES[:1], {"arm": 1}, "there is no signal plant.q of its joints"),
])  # fmt: skip
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
            PageServer(port)
        for words in (f"run tracking --live --port {port}", f"view planar_2dof --port {port}"):
            assert "Without it, one is chosen." in refused(*words.split())
    for words in ("run tracking --port 8000", "run x.ssp --robot planar_2dof"):
        assert "needs --live" in refused(*words.split())
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
    with pytest.raises(SystemExit) as end, live_view(True, None, None):
        raise CosimError("plant", "fmi2DoStep", 0.5, "it failed")
    assert end.value.code == 1
    assert seen == [None, None]
    output = capsys.readouterr()
    assert output.out.splitlines() == ["Live view: http://127.0.0.1:1"] * 2
    assert output.err.startswith("error: plant")


def test_the_address_of_a_robot_ends_its_line(monkeypatch):
    """What is copied to the end of the line is the address: a comma after it would be part of it."""
    monkeypatch.setattr(RobotView, "run", lambda self, ended: None)
    done = invoked("view", "planar_2dof")
    assert re.fullmatch(r"planar_2dof, until Ctrl-C: http://127\.0\.0\.1:\d+/[\w-]+/\n", done.output)


MESH = {"shape": "mesh", "size": [1, 1, 1], "color": [1, 0, 0, 1], "offset": [0, 0, 0], "rotation": np.eye(3)}


class Look:
    """A mesh of a robot."""

    def __init__(self, joint, file):
        vars(self).update(MESH | {"size": np.full(3, 0.5), "joint": joint, "file": file})


class Robot:
    """A robot of two meshes."""

    visuals = (Look(1, "mesh_1.stl"), Look(2, "mesh_2.obj"))


def test_meshes_are_shown_if_all_can_be_and_those_that_cannot_are_named(tmp_path, monkeypatch):
    parts, notes = mesh_parts(Robot, tmp_path)
    assert [note.partition(" cannot")[0] for note in notes] == ["mesh mesh_1.stl", "mesh mesh_2.obj"]
    (tmp_path / "mesh_2.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(mesh_parts(Robot, tmp_path)[1]) == 1
    corners = ("vertex 0 0 0", "vertex 0 0 2", "vertex 0 2 0")
    (tmp_path / "mesh_1.stl").write_text("\n".join(["solid a", "facet normal 1 0 0", "outer loop", *corners, "endloop",
                                                    "endfacet", "endsolid a"]))  # fmt: skip
    parts, notes = mesh_parts(Robot, tmp_path)
    assert notes == []
    assert [(part["body"], part["colour"]) for part in parts] == [(1, "#ff0000"), (2, "#ff0000")]
    triangles, corners = (parts[0]["mesh"][name] for name in ("triangles", "corners"))
    corners = corners.reshape(-1, 3)
    np.testing.assert_array_equal(np.sort(corners[triangles].sum(axis=1)), [0.0, 1.0, 1.0])  # half as large
    monkeypatch.setitem(sys.modules, "trimesh", None)
    parts, notes = mesh_parts(Robot, tmp_path)
    assert parts == []
    assert "'pip install vdfmu[view]'" in notes[0]


def test_a_pose_that_is_none_is_refused(capfd):
    view = RobotView(vdfmu.load_robot("planar_2dof"))
    try:
        for pose in ("[1]", "[1, null]", "[true, 0]", "[NaN, 0]", f"[1{400 * '0'}, 0]", f"[{5000 * '1'}, 0]", "1"):
            assert asked(view._server, f'{{"q": {pose}, "motors": "free"}}') == 400, pose
        assert asked(view._server, '{"q": [0, 0], "motors": []}') == 400
        assert view.pose.tolist() == [0.0, 0.0]
    finally:
        view.close()
    assert capfd.readouterr().err == ""


def test_pages_move_a_robot_together_and_hear_its_modes():
    view = RobotView(vdfmu.load_robot("planar_2dof"))
    try:
        pages = [Page(view._server, 1) for _ in range(2)]
        assert [page.next() for page in pages] == [{"q": [0.0, 0.0], "motors": "free", "from": ""}] * 2
        request = {"q": [0.5, -0.25], "motors": "held", "from": "a"}
        assert asked(view._server, json.dumps({"q": [0, 0]})) == 400
        assert asked(view._server, json.dumps(request)) == 204
        assert [page.next() for page in pages] == [request] * 2
        assert view.pose.tolist() == [0.5, -0.25]
        view.step(0.0)
        view.step(0.2)
        assert view._future is None  # the pose has not rested
        view.step(0.4)
        while view.modes is None:
            view.step(0.5)
            time.sleep(0.01)
        heard = pages[0].next()
        expected = vdfmu.natural_modes(view.robot, (0.5, -0.25), motors="held")
        assert [mode["frequency"] for mode in heard["modes"]] == expected.frequency.tolist()
        later = Page(view._server, 1)
        assert later.next() == request | heard
        for page in (*pages, later):
            page.close()
    finally:
        view.close()
