from tests.processes import python


def test_the_list_of_recordings_is_read_without_compiled_code():
    code = "import sys; from datasets.downloading import known_recordings; known_recordings(); "
    assert (
        python("-c", f"{code}print({{'numpy', 'numba', 'rosbags', 'requests'}} & set(sys.modules))").stdout == "set()\n"
    )
