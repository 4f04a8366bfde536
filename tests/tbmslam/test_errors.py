import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.errors import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("base_link", "base_link"),
        ("Küche 机器人", "Küche 机器人"),
        ("l\x1b]0;pwned\a\x1b[2J", "l\\x1b]0;pwned\\x07\\x1b[2J"),
        ("a\nfake: all is well\r", "a\\nfake: all is well\\r"),
        ("a\u202eb\u2028c", "a\\u202eb\\u2028c"),
        ("r\udcff", "r\\udcff"),
    ],
)
def test_letters_stay_and_what_steers_is_written_out(text, shown):
    assert printable(text) == shown


@given(st.text(st.characters(exclude_categories=[])))
def test_nothing_that_steers_is_left_and_a_second_time_changes_nothing(text):
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
