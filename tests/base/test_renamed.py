"""Names of earlier versions in files."""

from vdfmu.base.option import renamed


def test_keys_have_their_names_of_now_and_what_is_no_table_stays():
    assert renamed({"settings": {}, "master": "jacobi", "stop": 1.0}) == {
        "parameters": {}, "algorithm": "jacobi", "stop": 1.0,
    }  # fmt: skip
    assert renamed(3.5) == 3.5 and renamed(None) is None
