"""A viser server on loopback, and an arm in its scene."""

from __future__ import annotations

import contextlib
import io
import os
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.study.report.shapes import Chain, DrawnShape, own_shapes, turn_to
from vdfmu.study.view.shapes import Colour, blend, rgb

HOST = "127.0.0.1"
PERIOD = 1.0 / 30.0
"""Time between two pictures [s]."""
_FIELD = np.radians(34.0)
"""Angle of view [rad], from above to below."""


def needed() -> ModuleType:
    """Return viser; UsageError if it is not installed."""
    try:
        import viser
    except ImportError as error:
        raise UsageError(
            f"the view needs the package viser, which cannot be imported: {error}. Install it with "
            "'pip install vdfmu[view]'."
        ) from None
    return viser


def open_server(port: int | None, label: str) -> Any:
    """Start a viser server that only this machine reaches, and that reaches no other machine.

    By default at a free port; `label` is the title of the panel. UsageError if viser is missing, or the port is taken;
    VdfmuError if this viser starts its server otherwise, so that foreign pages could reach it.
    """
    viser = needed()
    from vdfmu.study.view.guard import Guard

    guard = Guard()
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    if port is not None:
        with contextlib.closing(socket.socket()) as probe:  # viser would silently take the next one
            try:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(os.name == "posix"))
                probe.bind((HOST, port))
            except (OSError, OverflowError) as error:
                raise UsageError(
                    f"--port {port}: expected a free port of {HOST}, got: {error}. Without it, one is chosen."
                ) from None
    # its own words name no way to end
    with contextlib.redirect_stdout(io.StringIO()), guard.placed_before("viser.infra._infra"):
        server = viser.ViserServer(HOST, port or 0, label, verbose=False)
    if not guard.placed:
        server.stop()
        raise VdfmuError(
            f"viser {viser.__version__} lets any page in the browser see the view, which cannot be prevented; expected "
            "viser 1.1. Install it: 'pip install vdfmu[view]'."
        )
    if port is not None and server.get_port() != port:
        server.stop()
        raise UsageError(f"--port {port}: was taken by another program just now. Without it, one is chosen.")
    server.token = guard.token
    server.request_share_url = lambda verbose=True: None  # it would open a tunnel to a foreign server
    clear(server, label)
    return server


def clear(server: Any, label: str) -> None:
    """Empty scene and panel, and dock the panel next to the scene."""
    server.scene.reset()
    server.gui.reset()
    server.gui.set_panel_label(label)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()


def address(server: Any) -> str:
    """Return the address for a browser, with the token that lets it in."""
    return f"http://{HOST}:{server.get_port()}/{server.token}/"


class ArmScene:
    """An arm in the scene of a server, by its `name` in the tree of the scene; a `ghost` is transparent.

    Rails of prismatic joints have the lengths `travel`, (n,) [m], by default a third of the reach. `visuals` are the
    tables ``[[visuals]]`` of the robot file, whose meshes are named relative to its `folder`.
    """

    def __init__(
        self,
        server: Any,
        chain: Chain,
        name: str = "arm",
        ghost: bool = False,
        travel: Sequence[float] | None = None,
        visuals: Sequence[Mapping[str, Any]] = (),
        folder: Path | None = None,
    ) -> None:
        self._server, self._scene, self.chain = server, server.scene, chain
        self._ghost = ghost
        self.root = self._scene.add_frame(name, show_axes=False)
        self._look = {"color": (47, 143, 232), "opacity": 0.3, "cast_shadow": False} if ghost else {}
        self.names, self._links = [name], list[Any]()
        for i in range(chain.n):
            self.names.append(f"{self.names[-1]}/link_{i + 1}")
            self._links.append(self._scene.add_frame(self.names[-1], show_axes=False))
        self.set(np.zeros(chain.n))
        self.notes: list[str] = []
        """Parts of the robot's looks that cannot be shown."""
        meshes = [v for v in visuals if v["shape"] == "mesh"]
        self.bodies = [] if folder is None else self._meshes(meshes, folder)
        if meshes and len(self.bodies) == len(meshes):
            parts = own_shapes(visuals)
        else:  # half an arm would look like all of it
            for handle in self.bodies:
                handle.remove()
            self.bodies = []
            parts = chain.parts(chain.reach / 3.0 if travel is None else travel, chain.reach)
        self._marked = list[Any]()
        for part in parts:
            handle = self.add(part, f"body_{len(self.bodies)}")
            self.bodies.append(handle)
            if part.colour == "joint":
                self._marked.append(handle)
        self._colours: list[Colour] = []

    def add(self, part: DrawnShape, name: str, **look: Any) -> Any:
        """Add a shape to its body; return viser's handle."""
        shrink = 0.97 if self._ghost else 1.0  # within the other where they are at one place
        name, size = f"{self.names[part.body]}/{name}", [shrink * float(each) for each in part.size]
        common = {"color": rgb(part.colour), "receive_shadow": False, **self._look, **look}
        common |= {"position": part.offset, "wxyz": _quaternion(part.rotation)}
        match part.shape:
            case "box":
                return self._scene.add_box(name, dimensions=tuple(size), **common)
            case "cylinder":
                return self._scene.add_cylinder(name, radius=size[0], height=size[1], **common)
            case "capsule":
                import trimesh

                mesh = trimesh.creation.capsule(size[1], size[0], count=[24, 16])
                return self._scene.add_mesh_simple(name, mesh.vertices, mesh.faces, **common)
            case _:
                scale = tuple(size) if len(size) == 3 else (size[0],) * 3
                return self._scene.add_icosphere(name, radius=1.0, scale=scale, subdivisions=4, **common)

    def _meshes(self, visuals: Sequence[Mapping[str, Any]], folder: Path) -> list[Any]:
        import trimesh

        handles: list[Any] = []
        for k, visual in enumerate(visuals):
            try:
                mesh: Any = trimesh.load(folder / visual["file"], force="mesh")
                mesh.apply_scale(visual["size"])
            except Exception as error:  # a reader of a foreign format may raise anything
                self.notes.append(f"mesh {visual['file']} cannot be shown: {error}")
                continue
            handles.append(
                self._scene.add_mesh_simple(
                    f"{self.names[visual['joint']]}/mesh_{k}", mesh.vertices, mesh.faces, flat_shading=True,
                    color=tuple(round(255.0 * part) for part in visual["color"][:3]),
                    position=visual["offset"], wxyz=_quaternion(np.array(visual["rotation"])), **self._look,
                )
            )  # fmt: skip
        return handles

    def set(self, q: Floats) -> None:
        """Move the joints to q, (n,) [rad or m]."""
        for handle, (R, p) in zip(self._links, self.chain.placements(q), strict=True):
            handle.wxyz, handle.position = _quaternion(R), p

    def colour(self, shares: Floats) -> None:
        """Colour the joints by values as shares of their largest, (n,)."""
        colours = [blend(float(share)) for share in shares]
        for handle, new, old in zip(self._marked, colours, self._colours or [None] * len(colours), strict=True):
            if new != old:
                handle.color = new
        self._colours = colours

    def frame(self, body: int, name: str, length: float, p: Floats | None = None, R: Floats | None = None) -> Any:
        """Add axes to a body, x red, y green, z blue; p and R place them in it."""
        return self._scene.add_frame(
            f"{self.names[body]}/{name}", axes_length=length, axes_radius=0.045 * length, origin_radius=0.07 * length,
            origin_color=(60, 68, 78), position=np.zeros(3) if p is None else p,
            wxyz=_quaternion(np.eye(3) if R is None else R),
        )  # fmt: skip


def stage(server: Any, chain: Chain, points: Floats) -> None:
    """Set up the surroundings of an arm: up, lights, a floor, its foot, a viewpoint that sees `points`, (m, 3) [m]."""
    scene, reach, up = server.scene, chain.reach, chain.up
    scene.set_up_direction(up)
    scene.configure_environment_map(None)
    scene.configure_default_lights(False)
    turn = turn_to(up)
    scene.add_light_hemisphere(
        "sky", sky_color=(255, 255, 255), ground_color=(170, 180, 192), intensity=2.2, position=tuple(up)
    )
    sun = up + turn @ np.array([0.5, -0.6, 0.0])
    scene.add_light_directional("sun", intensity=2.4, cast_shadow=True, position=tuple(3.0 * reach * sun))
    floor = min(0.0, float((points @ up).min())) - 0.1 * reach
    scene.add_grid(
        "floor", 4.0 * reach, 4.0 * reach, plane="xy", cell_size=0.25 * reach, section_size=reach, cell_thickness=0.6,
        section_thickness=0.9, cell_color=(222, 227, 233), section_color=(200, 207, 215), shadow_opacity=0.2,
        position=tuple(floor * up), wxyz=tuple(_quaternion(turn)),
    )  # fmt: skip
    r = 0.07 * reach
    foot = floor if floor > -0.6 * reach else 0.1 * reach  # an arm that hangs has it above
    scene.add_cylinder(
        "foot", radius=r, height=abs(foot), color=(86, 98, 112), position=foot * up / 2.0, wxyz=_quaternion(turn)
    )
    low, high = points.min(axis=0), points.max(axis=0)
    centre = (low + high) / 2.0
    size = max(0.4 * reach, float(np.linalg.norm(high - low)) / 2.0 + 0.1 * reach)
    view = turn @ np.array([0.95, -1.25, 0.62]) / np.linalg.norm([0.95, -1.25, 0.62])
    distance = size / np.sin(_FIELD / 2.0)
    camera = server.initial_camera
    camera.up, camera.look_at, camera.fov = up, centre, _FIELD
    camera.position, camera.near, camera.far = centre + distance * view, 0.02 * size, 60.0 * size

    @server.on_client_connect
    def _(client: Any) -> None:
        aspect = client.camera.image_width / max(1, client.camera.image_height)
        if aspect < 1.0:  # a phone, with the panel over the lower part
            away = distance / aspect
            above = up - (up @ view) * view
            middle = centre - 0.5 * away * np.tan(_FIELD / 2.0) * above / np.linalg.norm(above)
            client.camera.position = middle + away * view
            client.camera.look_at = middle


def _quaternion(R: Floats) -> Floats:
    from viser.transforms import SO3

    return np.asarray(SO3.from_matrix(R).wxyz, dtype=np.float64)
