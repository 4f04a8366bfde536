from tbmslam.report.downloads import downloads


def test_files_are_offered_where_they_are_and_others_are_not(tmp_path):
    folder = tmp_path / "robot #1"
    folder.mkdir()
    for name in ("map.npz", "map.yaml", "trajectory_b%.tum", "trajectory_a.tum", "mine.txt", "unknown.png"):
        (folder / name).touch()
    (folder / "map.tif").mkdir()
    assert downloads(tmp_path, folder) == [
        "robot%20%231/map.yaml",
        "robot%20%231/map.npz",
        "robot%20%231/trajectory_a.tum",
        "robot%20%231/trajectory_b%25.tum",
    ]
    assert downloads(folder, folder)[0] == "map.yaml"
    assert downloads(tmp_path, tmp_path) == []
