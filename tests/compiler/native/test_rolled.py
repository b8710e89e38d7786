"""Lines of C that repeat become loops, and only places in memory move on."""

from vdfmu.compiler.c.rolled import rolled


def test_lines_with_places_that_move_on_become_a_loop():
    lines = [f"w[{3 + 2 * k}] = a[{k}] * 2 + w[1];" for k in range(5)]
    assert rolled(lines) == ["for (int j = 0; j < 5; j++)", "    w[3 + 2 * j] = a[0 + 1 * j] * 2 + w[1];"]


def test_exponents_of_constants_do_not_move_on():
    for sign in "+-":
        lines = [f"w[{k}] = 1e{sign}{20 + k};" for k in range(5)]
        assert rolled(lines) == lines
