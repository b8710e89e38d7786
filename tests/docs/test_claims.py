"""What the documentation states: names of tests, pivots, frequencies and tolerances of the solver, stability."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.flexible_joint import rotor_transform
from vdfmu.arm.equations.mapping import jacobian, joint_space_mass_matrix, velocity_mapping
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.robot.structure import values as parameter_values
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.functions.rodas import ALPHA, GAMMA, GAMMA_I
from vdfmu.compiler.scalar.elimination import factorize, solve, sparse_of
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.parts import cached_fmus
from vdfmu.system.scenario.values import group_value, system_values

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
N = 6


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_named_tests_exist(page):
    text = page.read_text(encoding="utf-8")
    for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(test_\w+))?`", text):
        assert (ROOT / path).is_file(), path
        assert not name or re.search(rf"^def {name}\(", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE), name
    for name in re.findall(r"`(test_\w+)`", text):
        assert f"def {name}(" in (ROOT / "tests/arm/paper/test_errata.py").read_text(encoding="utf-8"), name


def test_every_erratum_test_is_documented():
    page = (ROOT / "docs/model.md").read_text(encoding="utf-8")
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests/arm/paper").glob("*.py"))
    names = re.findall(r"^def (test_erratum_\w+)\(", tests, re.MULTILINE)
    assert names and [name for name in names if name not in page] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_linked_files_exist(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        if "://" not in target and not target.endswith(
            (
                "interface.md",
                "robot_file.md",
                "command_line.md",
                "scenario_file.md",
                "rules.md",
                "gallery.md",
                "notebooks/first_run.md",
            )
        ):  # made when the pages are built
            assert (page.parent / target).exists(), target


def test_the_wrench_of_the_page_acts_on_the_arm_of_the_page():
    """One across the plane of the planar arm would go into its bearings."""
    page = (ROOT / "docs/world.md").read_text(encoding="utf-8")
    axis = int(re.search(r"^time,plant\.F_e\[(\d)\] \[N\]$", page, re.MULTILINE)[1])
    levers = jacobian(vdfmu.load_robot("planar_2dof"), np.array([0.3, 0.4]))[axis - 1]
    assert (np.abs(levers) > 0.1).all()  # m


def plant_jacobian(robot):
    """Return the Jacobian (24, 24) of the plant's derivatives as a function of the state, without torques."""
    call = Interface(shipped_units()["plant"], robot).functions.function("plant_jacobian")
    call.args["p"][:] = parameter_values(robot)

    def jacobian(x):
        call.args["x"][:] = x
        call.run()
        return call.results["J"].reshape(4 * N, 4 * N, order="F").copy()

    return jacobian


@pytest.mark.heavy
@pytest.mark.parametrize("coupling", [False, True])
def test_pivots_stay_positive(arm, coupling):
    # docs/solver.md: elimination in the solver's order, without row swaps, at 200 random states.
    arm = dataclasses.replace(arm, rotor_coupling=coupling)
    jacobian = plant_jacobian(arm)
    random = np.random.default_rng(0)
    order = np.concatenate(np.arange(4 * N).reshape(4, N)[[0, 2, 3, 1]])
    share = {1e-6: 0.9, 1e-4: 0.9, 1e-3: 0.9, 1e-2: 0.5}
    for _ in range(200):
        q = random.uniform(-np.pi, np.pi, N)
        v = random.uniform(-1.0, 1.0, N) * random.choice([1e-3, 1e-2, 0.1, 0.5])
        tau_s = equilibrium_torque(arm, q) + random.uniform(-10.0, 10.0, N)
        J = jacobian(np.concatenate([q, v, v + random.uniform(-0.02, 0.02, N), tau_s]))
        M = joint_space_mass_matrix(arm, q)
        E = np.eye(4 * N)
        E[N : 2 * N, N : 2 * N] = M
        if coupling:  # what q_ddot adds to the rotors' equations
            links = velocity_mapping(arm, q)
            for i in range(1, N):
                E[2 * N + i, N : 2 * N] = (rotor_transform(arm, i).T @ links[6 * i : 6 * i + 6])[5] / arm.ell[i]
        smallest = np.concatenate([np.ones(3 * N), np.full(N, np.linalg.eigvalsh(M)[0])])
        for h, least in share.items():
            W = (E / (h * GAMMA) - E @ J)[np.ix_(order, order)]
            LU = factorize(sparse_of(W))
            assert (np.array([row[k] for k, row in enumerate(LU)]) > least * smallest / (h * GAMMA)).all()
            b = random.normal(size=4 * N)
            pivoted = np.linalg.solve(W, b)
            # Some 50 roundings, as no pivot is small.
            assert np.abs(solve(LU, b) - pivoted).max() < 1e-14 * np.abs(pivoted).max()


def test_coefficients_of_time_on_the_page_are_those_of_the_step():
    page = (ROOT / "docs/solver.md").read_text(encoding="utf-8")
    for letter, values in ((r"\alpha_i", ALPHA), (r"\gamma_i", GAMMA_I)):
        cells = " | ".join(f"{value:.4g}".replace("-", "−") for value in values)
        assert f"| ${letter}$ | {cells} |" in page


def elastic_modes(arm, jacobian, gravity_holds, locked):
    """Return the lowest and highest elastic frequency [Hz] over the poses of (57), at rest, without friction."""
    found = []
    for s in np.linspace(0.0, 1.0, 101):
        q = s * np.radians([90.0, 60.0, 60.0, 90.0, 60.0, 90.0])
        tau_s = equilibrium_torque(arm, q) if gravity_holds else np.zeros(N)
        J = jacobian(np.concatenate([q, np.zeros(2 * N), tau_s]))
        if locked:
            keep = np.delete(np.arange(4 * N), np.s_[2 * N : 3 * N])
            J = J[np.ix_(keep, keep)]
        modes = np.sort(np.abs(np.linalg.eigvals(J).imag) / (2.0 * np.pi))
        modes = modes[modes > 2.0][::2]  # below is the pendulum, not the springs
        assert len(modes) == N  # one for each joint
        found += [modes[0], modes[-1]]
    return [round(min(found)), round(max(found))]


def test_elastic_frequencies_on_the_page_are_those_of_the_poses_of_the_motion(arm):
    # docs/solver.md, in whole Hz
    bare = arm.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
    jacobian = plant_jacobian(bare)
    page = (ROOT / "docs/solver.md").read_text(encoding="utf-8")
    for row, gravity_holds in (("loaded by gravity", True), ("without load", False)):
        free, locked = (elastic_modes(bare, jacobian, gravity_holds, locked) for locked in (False, True))
        assert f"| {row} | {free[0]} to {free[1]} | {locked[0]} to {locked[1]} |" in page
    # what the text above the table says of it
    low, high = elastic_modes(bare, jacobian, True, False)
    assert f"elastic modes at {low} to {high} Hz" in page


@pytest.mark.heavy
def test_stick_slip_amplifies_the_tolerance(tmp_path):
    # docs/solver.md: tracking without gravity, K_p = 100 and K_v = 5: below the falling branch of the friction
    scenario = load_scenario("tracking")
    scenario = dataclasses.replace(scenario, robot=scenario.robot.with_parameters(gravity=0.0))
    settings = system_values(scenario, {"controller.K_p": "100", "controller.K_v": "5"})
    package = write_ssp(scenario, cached_fmus(scenario, tmp_path), tmp_path / "system.ssp", settings)
    q = [
        vdfmu.simulate(
            package, stop=10.0, step=1e-3, algorithm="gauss-seidel", record=["plant.q[*]"],
            parameters={"plant.tolerance": tolerance},
        )["plant.q"]
        for tolerance in (1e-6, 1e-7, 1e-9, 1e-11)
    ]  # fmt: skip
    coarse, usual, fine = (np.abs(other - q[-1]).max() for other in q[:-1])
    # At the gains of the scenario 1e-7 is good for 4.6e-10 rad, as the page says. Here each change of sticking and
    # slipping amplifies, so the numbers have only their order: seen 4e-4, 6e-6 and 4e-8 rad.
    assert coarse > 1e-5
    assert usual > 1e-7 and usual > 1000.0 * 4.6e-10
    assert fine < 0.1 * usual


def growth(arm, jacobian, K_p, K_v, source):
    """Return the largest real part [1/s] of the closed loop at 0.5 rad/s along the poses of (57)."""
    velocity = slice(2 * N, 3 * N) if source == "kappa_dot" else slice(N, 2 * N)
    rotor = slice(2 * N, 3 * N)
    found = []
    for s in (0.0, 0.5, 1.0):
        q = s * np.radians([90.0, 60.0, 60.0, 90.0, 60.0, 90.0])
        J = jacobian(np.concatenate([q, np.full(2 * N, 0.5), equilibrium_torque(arm, q)]))
        J[rotor, :N] -= np.diag(K_p / arm.ell / arm.I_m)
        J[rotor, velocity] -= np.diag(K_v / arm.ell / arm.I_m)
        found.append(np.linalg.eigvals(J).real.max())
    return found


def test_derivative_on_the_link_is_unstable_and_on_the_rotor_stable(arm):
    # docs/model.md
    scenario = load_scenario("tracking")
    K_p, K_v = (group_value(scenario, f"controller.{name}") for name in ("K_p", "K_v"))
    jacobian = plant_jacobian(arm)
    assert max(growth(arm, jacobian, K_p, K_v, "kappa_dot")) < 0.0
    assert min(growth(arm, jacobian, K_p, K_v, "q_dot")) > 100.0
    assert min(growth(arm, jacobian, 0.1 * K_p, 0.1 * K_v, "q_dot")) > 10.0


def test_stability_numbers_of_the_default_gains(arm):
    # docs/cosimulation.md
    scenario = load_scenario("tracking")
    number = group_value(scenario, "controller.K_v") * scenario.step / (arm.ell * arm.I_m)
    assert [f"{x:.2f}" for x in number] == ["0.44", "0.44", "0.35", "0.26", "0.22", "0.18"]
    page = (ROOT / "docs/cosimulation.md").read_text(encoding="utf-8")
    assert "| $N$ | " + " | ".join(f"{x:.2f}" for x in number) + " |" in page


def test_bounds_of_the_rotor_alone():
    # docs/cosimulation.md: v' = v - N v is stable for N < 2, v' = v - N v_before for N < 1.
    for number, stable in ((1.99, True), (2.01, False)):
        assert (abs(1.0 - number) < 1.0) is stable
    for number, stable in ((0.99, True), (1.01, False)):
        assert bool(np.abs(np.roots([1.0, -1.0, number])).max() < 1.0) is stable


def test_the_figures_of_paper_and_citation_are_those_of_the_pages():
    paper, bib = ((ROOT / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib"))
    assert {*re.findall(r"@(\w+)\]", paper)} == {*re.findall(r"^@\w+\{(\w+),", bib, re.MULTILINE)}
    benchmarks, measured = (
        (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("benchmarks.md", "measured.md")
    )
    for said, row in (
        ("needs 3.2 ms", "| 10⁻⁶ | 3.2 | 16.4 (5.1) | | | 212 (66) | |"),
        ("takes 5.1 times and Drake 66 times", "| 10⁻⁶ | 3.2 | 16.4 (5.1) | | | 212 (66) | |"),
        (
            "by 15 % for inverse and 7 % for forward",
            "15 % fewer operations than ours with folded numbers in `rnea`, 7 % in `aba`",
        ),
        ("takes\n1.0 µs a step", "| vdfmu | 2.0 | CS, ME | nothing | yes | five | 0.98 | 87 | 1.0 |"),
        ("2.1 µs with PythonFMU", "| PythonFMU 0.7 | 2.0 | CS | Python | no | Linux, Windows | 0.07 | 660 | 2.1 |"),
        ("takes 12 µs", "| native FMUs, `gauss-seidel` | 12.0 |"),
        ("ecos 18 µs", "| ecos 0.7.2 | 17.9 |"),
        ("libcosim 35 to 76 µs", "Another run gave 35 µs for libcosim"),
    ):
        assert said in paper
        assert row in benchmarks
    assert "within 3 %" in paper and "3 %" in measured
    for said, name, shown in (
        ("262 published arms agree", "importing.md", "262 arms imported"),
        ("10⁻⁶ of the motion while its joints turn", "robot_r3.md", "10⁻⁶ of the motion while the joints turn"),
        ("eFMI checker has no finding", "efmi.md", "and the schemas | no finding"),
        ("five arms, with eleven differences", "compare.md", "five arms, eleven mismatches"),
    ):
        assert said in paper and shown in (ROOT / "docs" / name).read_text(encoding="utf-8"), said
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {vdfmu.__version__}\n" in citation
