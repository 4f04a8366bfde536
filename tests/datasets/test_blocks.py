import pytest

from datasets.blocks import in_blocks
from datasets.errors import DatasetError


@pytest.mark.parametrize("number", [0, 1, 256, 257, 1000])
def test_blocks_hold_all_items_in_their_order(number):
    assert [item for block in in_blocks(range(number)) for item in block] == list(range(number))


def test_what_comes_before_an_error_is_not_lost():
    def items():
        yield from range(300)
        raise DatasetError("damaged")

    blocks = in_blocks(items())
    assert next(blocks) + next(blocks) == list(range(300))
    with pytest.raises(DatasetError, match="damaged"):
        next(blocks)
