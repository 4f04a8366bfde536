import json

from tbmslam.incidents import Incident, Incidents


def test_an_incident_tells_its_time():
    assert Incident(112.34, "no scans", 5.0).text(100.0) == "at 12.3 s: no scans, for 5.0 s"
    assert Incident(112.34, "the odometry jumps").text(100.0) == "at 12.3 s: the odometry jumps"
    assert json.loads(json.dumps(Incident(112.5, "x").as_dict(100.0))) == {
        "at_s": 12.5,
        "stamp": 112.5,
        "what": "x",
        "seconds": 0.0,
    }


def test_memory_is_bounded_and_all_are_counted():
    incidents = Incidents()
    numbers = [incidents.add(float(k), "x") for k in range(150)]
    incidents.lengthen(numbers[3], 5.0)
    incidents.lengthen(numbers[3], 4.0)
    incidents.lengthen(numbers[149], 500.0)
    assert (len(incidents), incidents.number) == (100, 150)
    assert [incident.seconds for incident in incidents][:5] == [0.0, 0.0, 0.0, 2.0, 0.0]
