"""What is written as TOML is read back as it was."""

import tomllib

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vdfmu.base.toml_file import toml_text

TEXTS, NUMBERS, WHOLE = st.text(max_size=4), st.floats(allow_nan=False), st.integers(-(2**63), 2**63 - 1)
LISTS = st.one_of(*(st.lists(each, min_size=1, max_size=2) for each in (TEXTS, NUMBERS, st.booleans(), WHOLE)))
VALUES = st.dictionaries(TEXTS, st.one_of(TEXTS, NUMBERS, st.booleans(), WHOLE, LISTS), max_size=3)
TABLES = st.one_of(VALUES, st.dictionaries(TEXTS, st.dictionaries(TEXTS, VALUES, max_size=2), max_size=2))


@settings(max_examples=20, deadline=None)
@given(TABLES)
@example({"": ["\x00"]})
def test_a_table_is_read_back_as_it_was(table):
    assert tomllib.loads(toml_text(table)) == table


def test_every_control_character_is_escaped():
    text = "".join(map(chr, [*range(32), 0x7F]))
    assert tomllib.loads(toml_text({text: text})) == {text: text}
    assert tomllib.loads(toml_text({"n": np.int64(3), "b": np.True_})) == {"n": 3, "b": True}
