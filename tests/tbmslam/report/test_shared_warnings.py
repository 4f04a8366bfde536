from tbmslam.report.shared_warnings import by_whom


def test_what_several_are_told_alike_is_said_once_with_their_names():
    told = {"a": ["at 1.0 s: jumps", "odd"], "b": ["at 2.0 s: jumps"], "c": ["odd", "odd"]}
    assert by_whom(told) == ["a: at 1.0 s: jumps", "a, c: odd", "b: at 2.0 s: jumps"]
    assert by_whom({"a": []}) == []


def test_of_many_the_first_are_named():
    assert by_whom({name: ["odd"] for name in "abcdefg"}) == ["a, b, c, d, e and 2 more: odd"]
    assert by_whom({name: ["odd"] for name in "abcde"}) == ["a, b, c, d, e: odd"]
