from datasets.rosbag.file_names import is_ros1, storage_files


def test_files_are_told_apart_and_put_in_their_order(tmp_path):
    for name in ("run_10.db3", "run_9.db3", "run.db3", "metadata.yaml", "run_1.db3.zstd"):
        (tmp_path / name).touch()
    assert [path.name for path in storage_files(tmp_path)] == ["run.db3", "run_9.db3", "run_10.db3"]
    (tmp_path / "x").write_bytes(b"#ROSBAG V2.0\n")
    assert is_ros1(tmp_path / "x")
    assert not is_ros1(tmp_path / "run.db3")
    assert not is_ros1(tmp_path)
