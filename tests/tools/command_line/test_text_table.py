import platform

from tools.command_line.text_table import describe_machine, number, text_table


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


def test_processor_and_versions_are_named():
    machine = describe_machine()
    assert machine["python"] == platform.python_version()
    assert machine["cores"] >= 1
    assert machine["processor"]
    assert {"numpy", "numba", "tbmslam"} <= set(machine)
