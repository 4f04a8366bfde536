import hashlib

import pytest

from datasets.digest import file_digests
from datasets.errors import DatasetError


def test_files_are_told_by_their_content(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "b.db3").write_bytes(b"data")
    (tmp_path / "bag" / "a.yaml").write_bytes(b"")
    digests = file_digests([tmp_path / "bag"])
    assert digests[1] == {"name": "b.db3", "bytes": 4, "sha256": hashlib.sha256(b"data").hexdigest()}
    assert [one["name"] for one in digests] == ["a.yaml", "b.db3"]


def test_a_missing_file(tmp_path):
    with pytest.raises(DatasetError, match=r"x\.bag: no such file or directory"):
        file_digests([tmp_path / "x.bag"])
