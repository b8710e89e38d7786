"""A few inputs of each hostile corpus; `make hostile` tries them all."""

import pytest

from tests.hostile.corpora import CORPORA
from tests.hostile.table import Corpus, Row, replaced, table, tried
from vdfmu.base.errors import SspError


def marked(corpus: Corpus):
    """Return a corpus as a parameter; one in which processes have to start and end over and over is heavy."""
    return pytest.param(corpus, id=corpus.name, marks=[pytest.mark.heavy] if "moments" in corpus.name else [])


@pytest.mark.heavy
@pytest.mark.parametrize("corpus", [marked(corpus) for corpus in CORPORA if corpus.quick])
def test_hostile_inputs_are_read_or_refused_in_words(corpus):
    row = tried(corpus, range(corpus.quick))
    assert (row.tries, row.examples) == (corpus.quick * corpus.each, [])


def test_the_table_counts_failures():
    """A refusal without words, another exception and a slow try are failures; a refusal in words is none."""

    def attempt(number: int, _folder: object) -> None:
        if number < 2:
            raise SspError(["", "no zip"][number])
        if number == 2:
            raise KeyError("name")

    row = tried(Corpus("made up", 4, attempt), range(4))
    assert (row.refused, row.failures) == (2, 2)
    assert row.examples == ["made up, number 0: is refused without a word", "made up, number 2: KeyError: 'name'"]
    assert "| made up | 4 | 2 | 2 |" in table([row])
    page = f"Figures\n\n{table([Row('made up', 9), Row('other', 7)])}\n\nEnd"
    assert replaced(page, [row, Row("new", 1)]) == f"Figures\n\n{table([row, Row('other', 7), Row('new', 1)])}\n\nEnd"
    assert tried(Corpus("slow", 1, lambda *_: None, seconds=0.0), [0]).failures == 1
