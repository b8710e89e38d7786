"""Texts between components: one that is got seldom outlives all that others say in between."""

from ctypes import addressof, create_string_buffer, string_at

import numpy as np
import pytest

from vdfmu.engine.fmu.access import DTYPES, Transfer
from vdfmu.engine.fmu.variables import FmuVariable


def transfer(verb, values, places, called, kind="String"):
    """Return the call that gets or sets texts; `called` replaces the function of the FMU."""
    variables = [FmuVariable(f"v{i}", i, kind, "output", "discrete", None, native=kind) for i in places]
    made = Transfer(verb, variables, places, values, np.uintp, lambda _: [], lambda *words: AssertionError(*words))
    return made.around(lambda *_: called(made))


@pytest.mark.parametrize("kind", ["String", "Binary"])
def test_a_text_is_not_lost_while_others_change(kind):
    values = np.full(3, b"", DTYPES[kind])
    said = {0: b"of the slow one", 1: b""}
    seen = []

    def get(place):
        def function(made):
            made.buffer = create_string_buffer(said[place], len(said[place]) + 1)
            made.memory[0], made.sizes[0] = addressof(made.buffer), len(said[place])
            return 0

        return transfer("Get", values, [place], function, kind)

    def read(made):
        sizes = made.sizes if kind == "Binary" else [-1] * len(made.memory)
        seen.append([string_at(int(a), int(n)) for a, n in zip(made.memory, sizes, strict=True)])
        return 0

    slow, fast, sink = get(0), get(1), transfer("Set", values, [0, 1], read, kind)
    slow()
    for k in range(20_000):
        said[1] = b"%d" % k
        fast()
    sink()
    assert seen == [[b"of the slow one", b"19999"]]


def test_what_an_fmu_is_given_stays_until_it_is_given_another():
    """FMI lets an importer free a text after the call, but an FMU that keeps the address reads no other text."""
    values = np.array([b"first"], DTYPES["String"])
    kept = []
    give = transfer("Set", values, [0], lambda made: kept.append(int(made.memory[0])) or 0)
    give()
    give()
    assert kept[0] == kept[1] and string_at(kept[0]) == b"first"
    values[0] = b"a\0b".partition(b"\0")[0]
    give()
    assert string_at(kept[2]) == b"a"
