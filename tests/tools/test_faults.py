import pytest

from tools import faults, merge
from tools.fault_cases import bags, child_run, files, hostile_maps, program_run, sensors
from tools.fault_cases.fault_case import FaultCase, Outcome


def test_a_fault_that_was_survived_is_a_row_and_exit_0(capsys):
    assert faults.main(["--family", "bags", "--only", "holds nothing"]) == 0
    said = capsys.readouterr()
    assert "| sqlite database that holds nothing |" in said.out
    assert "/base_scan holds no messages: there is nothing to map" in said.out
    assert "1 faults tried, 0 rows red" in said.out
    assert said.err.startswith("ok ")


def test_a_red_row_and_a_trial_that_breaks_are_exit_1(monkeypatch, capsys):
    def broken(_):
        raise RuntimeError("no disk")

    lost = FaultCase("lost", lambda _: Outcome("exit -1", "everything", survived=False))
    monkeypatch.setattr(sensors, "CASES", (lost, FaultCase("broken", broken)))
    assert faults.main(["--family", "sensors"]) == 1
    said = capsys.readouterr().out
    assert "RED" in said
    assert "RuntimeError: no disk" in said
    assert "2 faults tried, 2 rows red" in said


def test_there_is_a_short_form_of_every_family():
    assert set(faults.FAMILIES) >= {"bags", "sensors", "files"}
    for family in (bags, sensors, files):
        assert 0 < sum(case.quick for case in family.CASES) < len(family.CASES)
        assert len({case.name for case in family.CASES}) == len(family.CASES)


def test_what_leaks_from_a_program_is_seen():
    def leaking(_):
        raise KeyError("topic")

    done = program_run.run_program(leaking, "x")
    assert (done.code, done.stderr) == (-1, "leaked KeyError('topic')\n")
    assert not done.is_one_line()


def test_a_child_that_is_not_seen_writing_is_told(tmp_path):
    with pytest.raises(child_run.ChildRunError, match="not seen doing what it was to be disturbed at"):
        child_run.run_child(merge, "--print-config", until=child_run.is_being_written(tmp_path / "none", "map.npz"))


def test_a_missed_moment_is_waited_for_again():
    trials = []

    def trial(number):
        trials.append(number)
        if number < 2:
            raise child_run.MissedMomentError("gone")
        return "seen"

    assert child_run.until_caught(trial) == "seen"
    assert trials == [0, 1, 2]
    with pytest.raises(child_run.MissedMomentError, match="never"):
        child_run.until_caught(lambda _: (_ for _ in ()).throw(child_run.MissedMomentError("never")))


def test_a_map_that_would_be_believed_is_a_red_row(tmp_path):
    case = hostile_maps._case("nothing wrong", lambda _: None, "damaged")
    outcome = case.attempt(tmp_path)
    assert not outcome.survived
    assert outcome.happened.startswith("exit ")


def test_wrong_usage_is_exit_2(capsys):
    with pytest.raises(SystemExit) as left:
        faults.main(["--family", "fire"])
    assert left.value.code == 2
