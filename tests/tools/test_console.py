import io
import sys

from tools.console import print_anything


def test_a_name_that_is_no_text_can_be_printed(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", stream)
    print_anything()
    stream.write("drive \udcff\n")
    stream.flush()
    assert stream.buffer.getvalue() == b"drive \\udcff\n"
