import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import MapPair
from tbmslam.geometry.se2 import SE2
from tools.map_pairs.known_pair import PairFileError, load_pair

CELLS = np.zeros((6, 8), np.int8)


@pytest.mark.parametrize("flipped", [4, 255])
def test_a_pair_with_any_damaged_byte_is_another_pair_or_an_error_of_one_line(tmp_path, flipped):
    path = MapPair("crop_flat", CELLS, CELLS, 0.05, SE2(1.0, 2.0, 0.5), 0.5).save(tmp_path)
    content = path.read_bytes()
    said = []
    for at in range(len(content)):
        path.write_bytes(content[:at] + bytes([content[at] ^ flipped]) + content[at + 1 :])
        try:
            load_pair(path)
        except PairFileError as error:
            said.append(str(error))
    assert not [text for text in said if "\n" in text]
    assert len(said) > len(content) / 2


def test_no_pair_names_the_program_that_makes_pairs(tmp_path):
    (tmp_path / "pair.npz").write_bytes(b"nothing of the kind")
    with pytest.raises(PairFileError, match=r"is not a pair of maps: .*: make pairs with tools/make_map_pairs\.py"):
        load_pair(tmp_path / "pair.npz")
