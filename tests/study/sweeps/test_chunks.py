"""How the points of a study are shared out."""

import numpy as np
import pytest

from vdfmu.study.sweeps.worker import LARGEST, Chunks


def taken(chunks, parts, seconds):
    """Return the chunks that are handed out, if each point takes some seconds."""
    handed = []
    while (chunk := chunks.take(parts)) is not None:
        handed.append(chunk)
        for _ in chunk:
            chunks.note(seconds)
    return handed


@pytest.mark.parametrize("together", [1, 8])
@pytest.mark.parametrize("points", [3, 40, 1000])
def test_no_worker_has_so_much_that_the_others_wait(points, together):
    handed = taken(Chunks(np.arange(points), lambda k: k, together=together), 4, 0.01)
    assert [k for chunk in handed for k in chunk] == list(range(points))
    left = points
    for chunk in handed:
        assert len(chunk) < left / 4 + together  # a quarter, rounded up to what runs side by side
        assert len(chunk) < LARGEST + together
        left -= len(chunk)


def test_a_chunk_takes_some_seconds_and_its_size_can_be_given_and_points_that_are_done_are_left_out():
    assert {len(c) for c in taken(Chunks(np.arange(1000), lambda k: k), 4, 5.0)} == {1, 2}
    assert [len(c) for c in taken(Chunks(np.arange(25), lambda k: k, 10), 4, 5.0)] == [10, 10, 5]
    points = np.array([1, 2, 5, 6, 7, 8])
    assert taken(Chunks(points, lambda k: k, 4), 4, 5.0) == [[1, 2], [5, 6, 7, 8]]
