"""What the documentation states: figures, names of tests, links, pivots and tolerances of the solver, stability."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from tests.docs import claims
from tests.docs.pages import PAGES as TUTORIALS_RUN
from tests.docs.pages import README, TOOLS
from tests.docs.quantities import N, growth, plant_jacobian
from vdfmu.arm.equations.flexible_joint import rotor_transform
from vdfmu.arm.equations.mapping import joint_space_mass_matrix, velocity_mapping
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.compiler.functions.rodas import GAMMA
from vdfmu.compiler.scalar.matrices import factorize, solve_factorized
from vdfmu.engine.run import simulate
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]


def name_of(page):
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
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


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_linked_files_exist(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        if "://" not in target and not target.endswith("notebooks/first_run.md"):  # made when pages are built
            assert (page.parent / target).exists(), target


@pytest.mark.heavy
@pytest.mark.parametrize("coupling", [False, True])
def test_pivots_stay_positive(arm, coupling):
    # docs/internals.md: elimination in the solver's order, without row swaps, at 200 random states.
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
            LU = factorize(W)
            pivots = 1.0 / np.array([row[k] for k, row in enumerate(LU)])  # a factor holds reciprocals
            assert (pivots > least * smallest / (h * GAMMA)).all()
            b = random.normal(size=4 * N)
            pivoted = np.linalg.solve(W, b)
            # Some 50 roundings, as no pivot is small.
            assert np.abs(solve_factorized(LU, b) - pivoted).max() < 1e-14 * np.abs(pivoted).max()


@pytest.mark.heavy
def test_stick_slip_amplifies_the_tolerance(tmp_path):
    # docs/internals.md: tracking without gravity, K_p = 100 and K_v = 5: below the falling branch of the friction
    scenario = load_scenario("tracking")
    scenario = dataclasses.replace(scenario, robot=scenario.robot.with_parameters(gravity=0.0))
    settings = system_values(scenario, {"controller.K_p": "100", "controller.K_v": "5"})
    package = write_ssp(scenario, cached_fmus(scenario, tmp_path), tmp_path / "system.ssp", settings)
    q = [
        simulate(
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


def test_derivative_on_the_link_is_unstable_and_on_the_rotor_stable():
    # docs/model.md
    assert max(growth("kappa_dot")) < 0.0 < min(growth("q_dot"))


UNIT = r" ?(?:%|°|(?:[kMmµn]?(?:s|Hz|m|g|W|J|N|rad|deg)|px|1/s)\b)"
VERSION = rf"\d+(?:\.\d+)*(?:-[a-z]+\.\d+)?(?!\.?\d|{UNIT})"
NAMED = r"[A-Z]\w*[A-Z]\w*|[A-Z]\w*\]|Python|Table|axis|axes|joints?|[Vv]ersions?:?\**(?: is)?"
NOT_MEASURED = (
    r"\$\$[^$]*\$\$|`[^`\n]*`|\]\([^)]*\)|https?://\S+|<[^>]*>|\$[^$]*\$",  # code, addresses, tags, formulas
    r"\((?:\d+[a-z]?|Eq\. \(?\d+\)?)\)",  # equations
    rf"\b(?:{NAMED}) {VERSION}(?:(?:,|,? and| or| to) {VERSION})*",  # Table 5, KR 300, joint 2, FMI 2.0 and 3.0
    r"\b(?:19|20)\d\d\b|\d+\.\d+\.\d+[\w.-]*|\d\.0, \d\.0 or \d\.0",  # years and versions
    rf"(?<![.,])\b[01]\b(?![.,]\d|{UNIT})",  # limits
    r"\b(?:\d?[A-Za-z_]\w*(?:-\d+)*)",  # words, such as UR10e, x86-64, 3D
)


WHOLE = ["README.md", *(f"docs/{name}.md" for name in "index laws drives model world checking".split())]
"""Pages of which each number is held, not only those of the first screen."""
TABLES = [f"docs/{name}.md" for name in "modes sweeps tuning benchmarks identification measured".split()]
"""Pages whose tables are held too, but for headings and first columns."""


def unclaimed(path, text):
    """Return the numbers on a page's first screen, or on the whole page, that nothing holds."""
    # Claims hold them, or `test_tutorials`, where they are the output of code that runs there.
    for claim in claims.claims():
        if claim.page == path:
            place = claim.place(text)
            for i in reversed(range(len(claim.parts) // 2)):
                text = text[: place.start(i + 1)] + text[place.end(i + 1) :]
    if path not in WHOLE:
        text, _, rest = text.partition("\n## ")
        if path in TABLES:
            rest = re.sub(r"^\|.*\n(?=\| ---)", "", rest, flags=re.MULTILINE)  # headings
            text = "\n".join([text, *re.findall(r"^\| .*? (\|.*)$", rest, re.MULTILINE)])
    kinds = "(?!text)" if ROOT / path not in [README, TOOLS, *TUTORIALS_RUN] else ""
    text = re.sub(rf"^```{kinds}.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    for pattern in NOT_MEASURED:
        text = re.sub(pattern, " ", text)
    return re.findall(r"\S*\d\S*", text)


WRITTEN = [*ROOT.joinpath(".gitignore").read_text(encoding="utf-8").split(), "docs/reference/command_line.md"]
"""Pages that `make docs` writes from the code."""


@pytest.mark.parametrize(
    "page", [page for page in PAGES if not any(page.relative_to(ROOT).match(each) for each in WRITTEN)], ids=name_of
)
def test_every_number_that_a_reader_sees_first_is_claimed(page):
    assert unclaimed(name_of(page), page.read_text(encoding="utf-8")) == []


def test_a_number_without_a_claim_is_seen():
    text = (
        "Within 3 % of FMI 2.0 and 3.0, 1.5 kHz by (57) of Table 5, at joint 1, `0.5`, 2·10⁻³ in 1 s.\n\n## More\n\n7 %"
    )
    assert unclaimed("docs/x.md", text) == ["3", "1.5", "2·10⁻³", "1"]
    page = (ROOT / WHOLE[-1]).read_text(encoding="utf-8")
    assert unclaimed(WHOLE[-1], f"{page}\n## More\n\n7 % in $$2 x$$") == ["7"]
    page = (ROOT / TABLES[0]).read_text(encoding="utf-8")
    assert unclaimed(TABLES[0], f"{page}\n## More\n\n6 %\n\n| 7 % | 8 % |\n| --- | --- |\n| 9 % | 5 % |\n") == ["5"]


@pytest.mark.parametrize("claim", claims.claims(), ids=lambda claim: f"{claim.page}: {claim.text[:40]}")
def test_pages_have_the_figures_of_the_claims_and_each_tolerance_has_a_reason(claim):
    assert list(claim.place((ROOT / claim.page).read_text(encoding="utf-8")).groups()) == claim.parts[1::2]
    assert claim.parts[1:] and sum(map(bool, (claim.command, claim.python, claim.seen))) == 1
    assert (claim.tolerance == "rounded") == (not claim.why)


RUNS = "numbers(", "gains_and_margins(", "contact_dampings("
"""Expressions that run a command or a whole scenario."""


def by_source():
    """Return the claims, a parameter for each command or expression."""
    sources = {}
    for claim in claims.claims():
        if not claim.seen:
            sources.setdefault(claim.command or claim.python, []).append(claim)
    for source, group in sources.items():
        heavy = group[0].command or any(run in source for run in RUNS)
        yield pytest.param(group, id=source, marks=[pytest.mark.heavy] if heavy else [])


@pytest.mark.parametrize("group", list(by_source()))
def test_claims_hold(group):
    for claim in group:
        numbers = claim.computed()
        assert all(map(claim.agrees, claim.parts[1::2], numbers)), (claim.text, numbers)
