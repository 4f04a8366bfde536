from tools.map_pairs.files import floors_of, shows_part

NAMES = [
    "crop_lab_f_035", "crop_corridor3_1_015", "crop_ex3_025", "crop_ex3part2mir_5_015",
    "negd_00_lab_f_ex3", "negd_ex3part1_ex3part1mir_4", "negs_02_ex3", "negs_office7_1",
    "negd_office7mir_store9_3", "negd_store9_store9mir_1",
]  # fmt: skip


def test_a_pair_shows_the_buildings_that_its_name_names():
    shown = floors_of(NAMES)
    assert shown["crop_lab_f_035"] == {"lab-f"}
    assert shown["crop_corridor3_1_015"] == {"corridor3"}
    assert shown["negd_00_lab_f_ex3"] == {"lab-f", "ex3"}
    assert shown["negs_office7_1"] == shown["negd_office7mir_store9_3"] == {"office7"}
    assert shown["negd_store9_store9mir_1"] == frozenset()  # no pair shows one place of it


def test_a_part_and_a_mirror_image_are_no_other_building():
    shown = floors_of(NAMES)
    assert shown["crop_ex3part2mir_5_015"] == shown["negd_ex3part1_ex3part1mir_4"] == shown["negs_02_ex3"] == {"ex3"}


def test_parts_are_told_from_whole_buildings():
    assert [name for name in NAMES if shows_part(name)] == ["crop_ex3part2mir_5_015", "negd_ex3part1_ex3part1mir_4"]
