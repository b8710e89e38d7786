"""`--set plant.q_0=0.3,-0.5`: one value for each element, however it is written."""

import numpy as np
import pytest

from vdfmu.base.errors import UsageError
from vdfmu.base.option import read_settings
from vdfmu.engine.package.system import spread
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


@pytest.mark.parametrize("text", ["0.3,-0.5", "[0.3,-0.5]", "[0.3, -0.5]", "0.3 -0.5", " 0.3 , -0.5 "])
def test_a_vector_gives_each_element_its_value(text):
    values = system_values(load_scenario("planar_tracking"), read_settings([f"plant.q_0={text}"]))["plant"]
    assert [values["q_0[1]"], values["q_0[2]"]] == [0.3, -0.5]


def test_a_matrix_is_read_row_by_row_and_other_texts_as_they_are():
    assert spread("[[1, 2], [3, 4]]", list("abcd")) == ["1", "2", "3", "4"]
    assert spread("1, 2", ["text"]) == ["1, 2"]  # a single variable may be a text
    assert spread("0.3", ["a", "b"]) == ["0.3", "0.3"]
    assert spread(np.array([1.0, 2.0]), ["a", "b"]) == [1.0, 2.0]


@pytest.mark.parametrize(("text", "said"), [
    ("0.3,-0.5,1", r"plant.q_0: expected one value, or 2 for q_0\[1\] to q_0\[2\], got 3"),
    ("0.3,x", r"plant.q_0: expected a number in rad, got '0.3,x'"),
    ("nan,0", r"plant.q_0\[1\]: expected a finite number, got nan rad"),
])  # fmt: skip
def test_a_wrong_vector_is_refused_in_words(text, said):
    with pytest.raises(UsageError, match=said):
        system_values(load_scenario("planar_tracking"), read_settings([f"plant.q_0={text}"]))
