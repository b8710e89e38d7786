"""Robots, random states and a kernel cache that several folders use."""

import cProfile
import gc
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from vdfmu.arm.equations.flexible_joint import state_names
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot, check_robot, load_robot, robot_from_dict
from vdfmu.arm.robot.parameters import JOINT_OPTIONS, section
from vdfmu.arm.units import shipped_units
from vdfmu.base import plugins
from vdfmu.base.cache import cache_folder
from vdfmu.base.errors import UsageError
from vdfmu.base.plugins import PluginTable
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.program import UnitFunctions
from vdfmu.compiler.unit.solver import Integrator

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None


class NoFiles(ModuleType):
    """A package that has no files for this Python, as `pyproject.toml` says: what needs it is skipped."""

    def __getattr__(self, name: str) -> object:
        """Skip the test, or the file that imports something of it; Python itself asks for names with underscores."""
        if name.startswith("__") and name != "__path__":
            raise AttributeError(name)
        here = f"Python {sys.version_info.major}.{sys.version_info.minor}"
        pytest.skip(f"{self.__name__} has no files for {here}", allow_module_level=True)


if sys.version_info >= (3, 15):
    for package in ("h5py", "libcosimpy", "mcap", "pinocchio", "rosbags", "toppra"):
        if find_spec(package) is None:
            sys.modules[package] = NoFiles(package)

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell starts what it runs in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def hangups_end_commands():
    """Let commands that tests start have SIGHUP again where it is ignored, as under nohup; the tests go on after one.

    A signal with a handler, unlike one that is ignored, has its default in programs that are started.
    """
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of tests that are heavy.

    Of a test with ``few(n)`` all are but n, spread over its cases. The first cases of the heavy tests in ``smoke.txt``,
    one of each kind, run in CI too.
    """
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("few") and not item.get_closest_marker("heavy"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for some in cases.values():
        few = next(some[0].iter_markers("few")).args[0]
        quick = {k * len(some) // few for k in range(few)}
        for k, item in enumerate(some):
            if k not in quick:
                item.add_marker(pytest.mark.heavy)
    lines = (line.split() for line in Path(__file__).with_name("smoke.txt").read_text().splitlines())
    left = {name: int(more[0]) if more else 1 for name, *more in lines}
    for item in items:
        name = item.nodeid.partition("[")[0]
        if left.get(name, 0) > 0 and item.get_closest_marker("heavy"):
            left[name] -= 1
            item.add_marker(pytest.mark.smoke)


TYPICAL = ("manipulator_6dof", "planar_2dof", "slider_3dof")
"""Shipped robots with all that the shipped robots have: what holds for them is not tested with the others again."""


def heavy(*values: object) -> list[Any]:
    """Return values of a parametrized test as heavy ones; a tuple has a value for each of several names."""
    cases = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*case, marks=pytest.mark.heavy) for case in cases]


def ran(*words: object, code: int = 0) -> Any:
    """Run a command that ends with a code; return its result."""
    done = invoked(*words)
    assert done.exit_code == code, f"{done.output}{done.exception}"
    return done


def refused(*words: object) -> str:
    """Return the UsageError of a command."""
    done = invoked(*words)
    assert isinstance(done.exception, UsageError), f"{done.output}{done.exception}"
    return str(done.exception)


def invoked(*words: object) -> Any:
    """Run a command; return its result."""
    from click.testing import CliRunner

    from vdfmu.cli.commands import app

    return CliRunner().invoke(app, [str(word) for word in words])


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Let one process of the test session build at a time: the next finds what it needs in the cache."""
    with (folder / "build.lock").open("w") as file:
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(tmp_path_factory):
    """Cache of this test session, shared by its processes; the user's own is neither read nor written."""
    # Except for what the compiler makes for itself of its own sources, once for each platform: minutes for Windows.
    support = os.environ.get("ZIG_GLOBAL_CACHE_DIR") or str(cache_folder() / "zig")
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "vdfmu_cache"
    folder.mkdir(exist_ok=True, mode=0o700)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VDFMU_CACHE_DIR", str(folder))
        patch.setenv("ZIG_GLOBAL_CACHE_DIR", support)
        yield folder


@pytest.fixture(scope="session")
def fmus_3(tmp_path_factory):
    """Return the native FMUs of FMI 3.0 of the planar arm by unit."""
    folder = tmp_path_factory.mktemp("fmus")
    return build_fmus(load_robot("planar_2dof"), folder, backend="native", fmi_version="3.0", folded=True)


@pytest.fixture
def calls():
    """Return what counts the calls that a function makes, of Python and of C: a cost that no busy machine changes."""

    def count(function: Callable[[], object]) -> int:
        profile = cProfile.Profile()
        profile.runcall(function)
        return sum(entry.callcount for entry in profile.getstats())

    return count


def random_rotation(random: np.random.Generator) -> np.ndarray:
    """Return a rotation matrix, (3, 3), evenly distributed."""
    Q, R = np.linalg.qr(random.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.sign(np.linalg.det(Q))


def random_inertia(random: np.random.Generator, size: float) -> np.ndarray:
    """Return the inertia [kg.m2] of 1 kg of points within about `size` [m], with products of inertia."""
    points = random.normal(scale=size, size=(8, 3))
    points -= points.mean(axis=0)
    return sum(np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points) / 8


def make_general_chain() -> Robot:
    """Return a chain with everything that the shipped robots leave out."""
    # Revolute and prismatic joints in any order, skewed axes, offsets and centres of mass in all directions, full
    # inertias, gravity in no axis, tool offset, payload, kinematic error, split friction.
    random = np.random.default_rng(20240501)
    types = ("revolute", "prismatic", "revolute", "revolute", "prismatic")
    n = len(types)
    linear = np.array([t == "prismatic" for t in types])

    def per_joint(revolute: float, prismatic: float) -> np.ndarray:
        return np.where(linear, prismatic, revolute) * random.uniform(0.8, 1.25, n)

    return check_robot(
        Robot(
            name="general", description="random chain", joint_types=types,
            rotation=np.array([random_rotation(random) for _ in range(n)]),
            offset=random.normal(scale=0.2, size=(n, 3)), mass=random.uniform(0.5, 3.0, n),
            centroid=random.normal(scale=0.1, size=(n, 3)),
            inertia=np.array([random_inertia(random, 0.1) for _ in range(n)]), gravity=np.array([1.0, -2.0, 9.5]),
            tool_offset=np.array([0.05, -0.1, 0.2]), tool_rotation=random_rotation(np.random.default_rng(20240503)),
            ell=per_joint(100.0, 600.0), I_m=per_joint(1e-3, 1e-2), K_f0=per_joint(15e3, 2e6),
            c_f=per_joint(4e-3, 1e-3), K_w0=per_joint(2.0, 5.0), c_w=per_joint(20.0, 15.0),
            theta_err_amplitude=per_joint(2e-4, 1e-5), theta_err_phase=random.uniform(-3.0, 3.0, n),
            f_c=per_joint(0.3, 8.0), f_s=per_joint(0.8, 14.0), f_v=per_joint(0.1, 60.0), v_s=per_joint(0.15, 0.05),
            f_ck=per_joint(0.03, 0.02), eps=per_joint(1e-2, 1e-2), friction="split", rotor_coupling=True, sources={},
            payload=True, **{row.name: np.zeros(n) for option in JOINT_OPTIONS for row in section(option)},
            payload_mass=np.array(1.7), payload_centroid=np.array([-0.04, 0.07, 0.1]),
            payload_inertia=1.7 * random_inertia(np.random.default_rng(20240502), 0.1),
        )
    )  # fmt: skip


@pytest.fixture(scope="session")
def arm():
    """Return the paper's arm."""
    return load_robot("manipulator_6dof")


@pytest.fixture(scope="session")
def planar():
    """Return the planar arm of two joints."""
    return load_robot("planar_2dof")


@pytest.fixture(scope="session", params=TYPICAL)
def robot(request):
    """Return each typical robot."""
    return load_robot(request.param)


@pytest.fixture(scope="session")
def general():
    """Return the random general chain."""
    return make_general_chain()


OPTIONS: dict[str, dict[str, float]] = {
    "hysteresis": {"K_h": 5e3, "f_h": 3.0},
    "load_loss": {"mu_l": 0.2},
    "backlash": {"w_gap": 2e-4, "tau_gap": 0.5},
    "bristles": {"sigma_0": 2e4, "sigma_1": 50.0},
    "winding": {"k_t": 0.1, "R_w": 0.5, "L_w": 1e-3, "U_max": 48.0, "i_max": 20.0, "w_i": 3e3},
    "thermal": {"T_ref": 293.15, "T_v": 20.0, "T_amb": 300.0, "C_th": 500.0, "G_th": 2.0},
    "counterbalance": {"F_cb": 200.0, "D_cb": 0.3, "r_cb": 0.1, "delta_cb": 0.4, "L_cb": 0.25},
}
"""What drives may have beside the paper's, each by itself a table of a robot file."""


def make_optional(*options: str, name: str = "planar_2dof", **changes: Any) -> Robot:
    """Return a shipped robot with options, the same at all joints; `changes` by name of the parameter."""
    data = load_robot(name).to_dict()
    for joint in data["joints"]:
        for option in options:
            joint[option] = {key: changes.get(key, value) for key, value in OPTIONS[option].items()}
    return robot_from_dict(data)


@pytest.fixture(scope="session")
def with_options():
    """Return the function ``with_options("hysteresis", ..)``; by default with all."""
    return lambda *options, **changes: make_optional(*(options or OPTIONS), **changes)


class Draw(NamedTuple):
    """A random state with inputs: angles over the full turn, velocities and accelerations of a few units."""

    q: np.ndarray
    q_dot: np.ndarray
    q_ddot: np.ndarray
    kappa_dot: np.ndarray
    tau_s: np.ndarray
    tau: np.ndarray
    F_e: np.ndarray

    @property
    def x(self) -> np.ndarray:
        """State vector of the plant."""
        return np.concatenate([self.q, self.q_dot, self.kappa_dot, self.tau_s])


def draw_states(robot: Robot, count: int, seed: int) -> list[Draw]:
    """Return `count` random states."""
    random = np.random.default_rng(seed)
    n = robot.n
    return [
        Draw(
            q=random.uniform(-np.pi, np.pi, n), q_dot=random.uniform(-2.0, 2.0, n),
            q_ddot=random.uniform(-5.0, 5.0, n), kappa_dot=random.uniform(-2.0, 2.0, n),
            tau_s=random.uniform(-30.0, 30.0, n), tau=random.uniform(-0.5, 0.5, n),
            F_e=random.uniform(-20.0, 20.0, 6),
        )
        for _ in range(count)
    ]  # fmt: skip


@pytest.fixture(scope="session")
def draw():
    """Return the function ``draw(robot, count, seed)``."""
    return draw_states


@pytest.fixture(scope="session")
def kernel_of(kernel_cache):
    """Return a function that gives a robot's kernel, traced once a session."""

    def kernel(robot: Robot) -> Kernel:
        return Kernel(robot, kernel_cache)

    return kernel


@pytest.fixture(scope="session")
def functions_of(kernel_cache):
    """Return the function ``functions_of(unit, robot)``: traced functions of a shipped unit."""

    def functions(unit: str, robot: Robot) -> UnitFunctions:
        return UnitFunctions(shipped_units()[unit], robot, kernel_cache)

    return functions


@pytest.fixture(scope="session")
def plant_function(functions_of):
    """Return ``plant_function(robot, "derivatives")``, traced, of (x, tau, F_e); ``"jacobian"`` gives a matrix."""

    def bound(robot: Robot, name: str):
        function, p = functions_of("plant", robot).function(f"plant_{name}"), robot.values()
        m = len(state_names(robot)) * robot.n
        shape = (m, m) if name == "jacobian" else (m,)
        (result,) = function.results.values()

        def call(x, tau, F_e):
            for array, value in zip(function.args.values(), (p, x, tau, F_e), strict=True):
                array[:] = value
            function.run()
            return result.reshape(shape, order="F").copy()

        return call

    return bound


@pytest.fixture(scope="session")
def plant_solver():
    """Return ``plant_solver(robot)``: the solver of the plant; ``.unit.group("tau")`` are its inputs."""

    def solver(robot: Robot) -> Integrator:
        return Integrator(Traced(Interface(shipped_units()["plant"], robot)))

    return solver


@pytest.fixture
def added(monkeypatch):
    """Return a function that adds the packages in a folder for one test."""
    plugins._points.cache_clear()
    yield lambda folder: monkeypatch.syspath_prepend(str(folder))
    plugins._points.cache_clear()
    for table in [each for each in gc.get_objects() if isinstance(each, PluginTable)]:
        for name in {*table} - table._shipped:
            del table[name]


@pytest.fixture(params=["pipe", "device", "socket", "folder", "link to a pipe"])
def special(request, tmp_path, monkeypatch):
    """Return the path of a file that is not regular, in the working directory."""
    monkeypatch.chdir(tmp_path)  # the name of a socket has at most 107 bytes
    path = Path("special")
    if request.param == "folder":
        path.mkdir()
    elif request.param == "device":
        path.symlink_to("/dev/zero")
    elif request.param == "socket":
        with closing(socket.socket(socket.AF_UNIX)) as listener:
            listener.bind(str(path))
    else:
        os.mkfifo("pipe")
        path.symlink_to("pipe")
    return path
