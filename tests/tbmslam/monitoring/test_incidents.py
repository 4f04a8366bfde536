import json
import re
from pathlib import Path

from tbmslam.monitoring.drive_monitor import LOST
from tbmslam.monitoring.incidents import Incident, Incidents
from tbmslam.monitoring.odometry_check import DISAGREE

ROOT = Path(__file__).resolve().parents[3]


def test_an_incident_has_its_time():
    assert Incident(112.34, "no scans", 5.0).text(100.0) == "at 12.3 s: no scans, for 5.0 s"
    assert Incident(112.34, "the odometry jumps").text(100.0) == "at 12.3 s: the odometry jumps"
    assert json.loads(json.dumps(Incident(112.5, "x").as_dict(100.0))) == {
        "at_s": 12.5,
        "stamp": 112.5,
        "what": "x",
        "seconds": 0.0,
        "all_along": False,
    }


def test_what_holds_all_along_has_no_time():
    incident = Incident(100.0, "a wrong scale", 60.0, all_along=True)
    assert incident.text(100.0) == "a wrong scale"
    told = incident.as_dict(100.0)
    assert (told["at_s"], told["seconds"], told["all_along"]) == (0.0, 60.0, True)


def test_incidents_come_by_time_and_first_what_holds_all_along():
    incidents = Incidents()
    late = incidents.add(9.0, "late")
    incidents.add(3.0, "early")
    incidents.add(3.0, "as early")
    incidents.conclude(5.0, "left out", 1.0)
    incidents.conclude(4.0, "a wrong scale", 60.0, all_along=True)
    assert [incident.what for incident in incidents] == ["a wrong scale", "early", "as early", "left out", "late"]
    incidents.reopen()
    incidents.reword(late, "later")
    assert [incident.what for incident in incidents] == ["early", "as early", "later"]


def test_memory_is_bounded_and_all_are_counted():
    incidents = Incidents()
    numbers = [incidents.add(10.0 * k, "x") for k in range(150)]
    incidents.lengthen(numbers[3], 32.0)
    incidents.lengthen(numbers[3], 31.0)
    incidents.lengthen(numbers[149], 5000.0)
    assert (len(incidents), incidents.number) == (100, 150)
    assert [incident.seconds for incident in incidents][:5] == [0.0, 0.0, 0.0, 2.0, 0.0]


def test_a_continued_incident_is_one_incident():
    incidents = Incidents()
    for stamp in (1.0, 2.0, 5.0, 20.0):
        incidents.add(stamp, "stamps step back")
        incidents.add(stamp + 0.1, "no scans", 0.5)
    assert [incident.text(0.0) for incident in incidents] == [
        "at 1.0 s: stamps step back, for 4.0 s",
        "at 1.1 s: no scans, for 4.5 s",
        "at 20.0 s: stamps step back",
        "at 20.1 s: no scans, for 0.5 s",
    ]


def test_everything_that_can_go_wrong_is_explained():
    """The words that programs give incidents are the rows of a table."""
    text = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8")
    named = [DISAGREE, LOST.partition(": ")[0], "a part of the robot", "the scans go"]
    written = [
        re.split(r"[{,]", call["words"])[0].strip()
        for package in ("tbmslam", "datasets")
        for path in sorted((ROOT / package).rglob("*.py"))
        for call in re.finditer(
            r"incidents\.(?:add|conclude)\([^\"()]*f?\"(?P<words>[^\"]+)\"", path.read_text(encoding="utf-8")
        )
    ]
    assert len(written) == 6
    assert [words for words in (*named, *written) if words not in text] == []


def test_the_text_of_an_incident_is_updated():
    incidents = Incidents()
    number = incidents.add(3.0, "a part")
    incidents.reword(number, "two parts")
    incidents.reword(number + 7, "nothing")
    assert [incident.text(1.0) for incident in incidents] == ["at 2.0 s: two parts"]


def test_incidents_of_the_whole_drive_are_listed_first():
    incidents = Incidents()
    for k in range(150):
        incidents.add(10.0 * k, "x")
    incidents.conclude(0.0, "a wrong scale", 60.0, all_along=True)
    assert (len(incidents), incidents.number) == (100, 151)
    assert next(iter(incidents)).text(0.0) == "a wrong scale"


def test_incidents_of_the_end_are_removed_if_the_drive_continues():
    incidents = Incidents()
    lost = incidents.add(3.0, "lost")
    incidents.conclude(0.0, "a wrong scale", 5.0, all_along=True)
    incidents.conclude(0.0, "left out", 3.0)
    assert [incident.what for incident in incidents] == ["a wrong scale", "left out", "lost"]
    incidents.reopen()
    incidents.lengthen(lost, 4.0)
    assert [incident.text(0.0) for incident in incidents] == ["at 3.0 s: lost, for 1.0 s"]
    assert incidents.number == 1


def test_what_there_was_no_room_for_is_taken_back_too():
    incidents = Incidents()
    for k in range(100):
        incidents.add(10.0 * k, "x")
    incidents.conclude(0.0, "left out", 3.0)
    assert (len(incidents), incidents.number) == (100, 101)
    incidents.reopen()
    assert (len(incidents), incidents.number) == (100, 100)


def test_an_incident_that_a_warning_of_the_whole_drive_pushed_out_returns():
    incidents = Incidents()
    numbers = [incidents.add(10.0 * k, "x") for k in range(100)]
    incidents.conclude(0.0, "a wrong scale", 60.0, all_along=True)
    assert [incident.stamp for incident in incidents][-1] == 980.0
    incidents.reopen()
    incidents.lengthen(numbers[-1], 992.0)
    assert [(incident.stamp, incident.seconds) for incident in incidents][-1] == (990.0, 2.0)
