import numpy as np
import pytest

from merging.experiments.published import TABLE_1, TABLE_2, TABLE_3, TABLE_4, table_2


def test_table_1_line_by_line():
    """As the paper prints it: ORB, BRISK, SIFT, SURF, and the best of each line."""
    assert list(TABLE_1) == ["ORB", "BRISK", "SIFT", "SURF"]
    assert list(zip(*TABLE_1.values(), strict=True)) == [
        (0.958, 0.889, 0.25, 0.0),
        (1.0, 1.0, 1.0, 0.951),
        (0.714, 0.5, 0.0, 0.0),
        (0.993, 1.0, 1.0, 1.0),
        (0.96, 0.818, 0.0, 0.0),
        (0.999, 1.0, 1.0, 1.0),
        (0.999, 0.998, 1.0, 0.996),
    ]


def test_the_sums_of_tables_2_to_4():
    """Counted from the paper's text: a column's sum changes with any of its values."""
    rows = [table_2(*key).values for key in TABLE_2]
    sums = [tuple(np.sum([row[letter] for row in rows], axis=0)) for letter in "abcde"]
    expected = [(13.11, 1.44), (14.47, 0.84), (7.04, 0.80), (7.78, 1.00), (8.43, 1.36)]
    np.testing.assert_allclose(sums, expected, atol=1e-6)
    assert np.sum(TABLE_3, axis=0) == pytest.approx([0.138, 149.014, 1.510])
    assert np.sum(TABLE_4, axis=0) == pytest.approx([84925.0, 9762.7, 817.921])


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
