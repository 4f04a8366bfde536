import pytest

from merging.experiments.published import TABLE_2, table_2


def test_a_row_of_table_2():
    row = table_2(1000, 0.7)
    assert row.values["b"] == (0.83, 0.03)
    assert row.values["e"] == (0.22, 0.05)
    assert row.best == "b"


def test_every_row_is_whole():
    for keypoints, ratio in TABLE_2:
        row = table_2(keypoints, ratio)
        assert list(row.values) == list("abcde")
        assert set(row.best) <= set("abcde")
    assert len(TABLE_2) == 20


def test_other_rows_there_are_none():
    with pytest.raises(ValueError, match=r"table II has no row of 7 keypoints at ratio 0.7"):
        table_2(7, 0.7)
