"""Loops that only repetition solves: algebraic ones, of the initialization too; and the method."""

import numpy as np
import pytest

from vdfmu.base.errors import CosimError, SspError
from vdfmu.engine.masters.broyden import Broyden
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run import simulate


@pytest.mark.few(1)
@pytest.mark.parametrize("k", [(0.5, 0.5), (-3.0, 2.0), (4.0, 5.0)])
def test_algebraic_loops_are_solved(pack, k):
    """A = k0 b, b = k1 a + t: in the initialization by every master, in the steps by iterative."""
    path = pack(
        ["a Gain u:input y:output", "b Adder a:input b:input y:output", "t Ramp y:output", "g Gain u:input y:output"],
        ["b.y -> a.u", "a.y -> g.u", "g.y -> b.a", "t.y -> b.b"],
    )
    parameters = {"a.k": k[0], "g.k": k[1], "t.slope": 1.0}
    options = {"start": 1.0, "stop": 3.0, "step": 0.5, "parameters": parameters}
    results = simulate(path, algorithm="iterative", **options)
    expected = results.time / (1.0 - k[0] * k[1])
    # 1e-8 of its size between guess and outcome, and what the loop makes of it
    np.testing.assert_allclose(results["b.y"], expected, rtol=1e-8 * max(1.0, 2 / abs(1 - k[0] * k[1])))
    (note,) = [note for note in results.summary["notes"] if "loop" in note]
    assert note.startswith("algebraic loop during initialization, solved: ")
    first = simulate(path, algorithm="jacobi", **options)
    np.testing.assert_allclose(first["b.y"][0], expected[0], rtol=1e-7)
    with pytest.raises(SspError, match="algebraic loop in the steps: .*; jacobi breaks it"):
        simulate(path, algorithm="gauss-seidel", **options)


def test_a_loop_without_a_solution_of_integers_or_of_no_numbers_is_told(pack, xml):
    path = pack(["b Adder a:input b:input y:output", "t Ramp y:output"], ["b.y -> b.a", "t.y -> b.b"])  # y = y + t
    with pytest.raises(
        CosimError, match=r"b failed .* in initialization: .*do not agree: b\.y -> b\.a .*Algebraic loop"
    ):
        simulate(path, start=1.0, stop=2.0, step=0.5, algorithm="iterative")
    units = ["a Logic ii:input io:output", "b Logic ii:input io:output"]
    links = ["a.io -> b.ii", "b.io -> a.ii"]  # i = i + 2 has no solution
    with pytest.raises(CosimError, match="do not agree"):
        simulate(pack(units, links), stop=1.0, step=0.5, algorithm="jacobi")
    entries = "".join(f'<ssc:MapEntry source="{i}" target="0"/>' for i in (1, 2))
    table = f"<ssc:IntegerMappingTransformation>{entries}</ssc:IntegerMappingTransformation>"
    links = [xml.connection("a.io -> b.ii", table), "b.io -> a.ii"]  # b reads 0 for 1 and for 2
    results = simulate(pack(units, links), stop=1.0, step=0.5, algorithm="jacobi")
    assert (results["a.io"][0], results["b.io"][0]) == (2, 1)
    path = pack(["b Adder a:input b:input y:output", "t Ramp y:output"], ["b.y -> b.a", "t.y -> b.b"])
    with pytest.raises(CosimError, match=r"b\.y -> b\.a is not a number"):
        simulate(path, start=2.0, stop=3.0, step=0.5, parameters={"t.slope": 1e308}, algorithm="iterative")


def test_one_loop_of_many_connections_is_one_note_and_is_torn_at_one_unit(pack, xml):
    c, n = xml.component, 40
    path = pack(
        [c("a", "Wide", " ".join(f"u{i}:input y{i}:output" for i in range(n))),
         c("b", "Wide", " ".join(f"u{i}:input y{i}:output" for i in range(n)))],
        [f"{x}.y{i} -> {y}.u{i}" for i in range(n) for x, y in (("a", "b"), ("b", "a"))],
    )  # fmt: skip
    checked = check_system(load_ssp(path), algorithm="jacobi")
    assert len(checked.schedule.initial.torn) == n
    assert {link.end[0] for link in checked.schedule.initial.torn} in ({"a"}, {"b"})
    assert len([note for note in checked.notes if "loop" in note]) == 1
    results = simulate(path, stop=1.0, step=0.5, algorithm="jacobi")
    assert results["a.y3"].tolist() == [3.0, 3.0, 3.0]


def solve(solver, A, b, tolerance=1e-8):
    """Find x = A x + b from 0; return x and the number of repetitions."""
    last = np.zeros(len(b))

    def repeat(guess):
        last[:] = guess
        return A @ guess + b

    sizes, count = solver.solve(
        np.zeros(len(b)), repeat, lambda residual: np.abs(residual) / np.maximum(np.abs(last), 1.0), tolerance
    )
    return last, count, bool(np.all(sizes <= tolerance))


def draw(n, gain, seed):
    """Return a dense matrix with a spectral radius of `gain`, and a right-hand side."""
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    return A * gain / np.abs(np.linalg.eigvals(A)).max(), random.normal(size=n)


@pytest.mark.parametrize("gain", [0.5, 9.0, 14.0, 40.0])
@pytest.mark.parametrize("n", [1, 8, 24, 40])
def test_broyden_solves_linear_loops_of_any_size_and_gain(n, gain):
    for seed in range(3):
        A, b = draw(n, gain, seed)
        solver = Broyden()
        solution, count, solved = solve(solver, A, b)
        assert solved
        exact = np.linalg.solve(np.eye(n) - A, b)
        # a residual of 1e-8 of the largest value, times what the loop makes of it
        bound = 1e-8 * np.linalg.norm(np.linalg.inv(np.eye(n) - A), np.inf) * max(1.0, np.abs(solution).max())
        assert np.abs(solution - exact).max() <= bound
        assert count <= max(30, 3 * n)
        # what was learnt serves the next problem of the same loop
        _, again, solved = solve(solver, A, b + 0.1)
        assert solved and again <= max(count, 3)
