from tools.command_line.text_table import number, text_table


def test_columns_are_as_wide_as_their_widest_cell():
    table = text_table(("name", "preset", "scans"), [("a", "default", "7"), ("longer", "viny", "12345678")])
    assert table.splitlines() == [
        "| name   | preset  |    scans |",
        "| ------ | ------- | -------: |",
        "| a      | default |        7 |",
        "| longer | viny    | 12345678 |",
    ]


def test_nothing_is_a_dash():
    assert number(None, 3) == "-"
    assert number(1.23456, 3) == "1.235"
