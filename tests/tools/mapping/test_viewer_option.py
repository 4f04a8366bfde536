import argparse

import pytest

from tools.mapping.viewer_option import LIVE, add_viewer_option


@pytest.fixture
def grammar():
    made = argparse.ArgumentParser()
    made.add_argument("bags", nargs="+")
    add_viewer_option(made)
    return made


@pytest.mark.parametrize(
    ("words", "value"), [(["a.bag"], None), (["a.bag", "--viewer"], LIVE), (["a.bag", "--viewer", "b.rrd"], "b.rrd")]
)
def test_live_or_into_a_file(grammar, words, value):
    assert grammar.parse_args(words).viewer == value


def test_a_recording_is_not_taken_for_the_file(grammar, capsys):
    with pytest.raises(SystemExit):
        grammar.parse_args(["--viewer", "a.bag", "b.bag"])
    assert "--viewer: must end with .rrd, or be the last word for live viewing, got 'a.bag'" in capsys.readouterr().err
