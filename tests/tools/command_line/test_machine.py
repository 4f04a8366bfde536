import platform

from tools.command_line.machine import describe_machine


def test_processor_and_versions_are_named():
    machine = describe_machine()
    assert machine["python"] == platform.python_version()
    assert machine["cores"] >= 1
    assert machine["processor"]
    assert {"numpy", "numba", "tbmslam"} <= set(machine)
