from tests.processes import python


def test_parameters_do_not_wait_for_methods():
    heavy = "{'scipy.optimize', 'merging.rigid_alignment', 'merging.merger'}"
    code = f"import sys, merging.config; print({heavy} & set(sys.modules))"
    assert python("-c", code).stdout == "set()\n"
