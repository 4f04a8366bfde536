from tools.command_line.paths import list_maps


def test_a_folder_is_replaced_by_its_maps_in_the_order_of_their_numbers(tmp_path):
    for name in ("robot_10", "robot_9", "robot_0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "map.npz").touch()
    (tmp_path / "notes").mkdir()
    (tmp_path / "hall").mkdir()
    (tmp_path / "hall" / "map.yaml").touch()
    found = list_maps([tmp_path / "robot_9", tmp_path, tmp_path / "none.yaml"])
    assert [path.name for path in found] == ["robot_9", "hall", "robot_0", "robot_9", "robot_10", "none.yaml"]


def test_files_that_are_made_beside_maps_are_no_maps(tmp_path):
    for name in ("robot_0", "robot_1", "truth.json"):
        (tmp_path / name).mkdir()
    for name in ("robot_0/map.npz", "robot_1/map.npz", "truth.json/map.npz", "report.html", "notes.txt"):
        (tmp_path / name).touch()
    found = list_maps([*sorted(tmp_path.iterdir()), tmp_path / "none" / "report.html"])
    assert [path.name for path in found] == ["notes.txt", "robot_0", "robot_1", "truth.json", "report.html"]


def test_a_folder_without_maps_is_left_for_the_reader_to_refuse(tmp_path):
    assert list_maps([tmp_path]) == [tmp_path]
