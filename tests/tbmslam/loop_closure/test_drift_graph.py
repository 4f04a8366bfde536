from tbmslam.loop_closure.drift_graph import DriftGraph


def test_ways_lead_back_along_the_drive():
    graph = DriftGraph()
    for travelled in (4.0, 8.0, 12.0):
        graph.add_place(travelled)
    assert graph.ways_from(30.0).tolist() == [26.0, 22.0, 18.0]


def test_meeting_a_place_makes_all_ways_over_it_short():
    graph = DriftGraph()
    for travelled in (4.0, 8.0, 12.0):
        graph.add_place(travelled)
    graph.meet(0, 50.0)
    assert graph.ways_from(51.0).tolist() == [1.5, 5.5, 9.5]


def test_a_stretch_between_two_meetings_joins_their_places():
    graph = DriftGraph()
    for travelled in (4.0, 104.0):
        graph.add_place(travelled)
    graph.meet(0, 200.0)
    graph.meet(1, 210.0)
    graph.meet(0, 300.0)
    assert graph.ways_from(300.0).tolist() == [0.5, 0.5 + 11.0]


def test_a_place_learnt_of_later_lies_where_it_was_passed():
    graph = DriftGraph()
    graph.add_place(4.0)
    graph.meet(0, 100.0)
    late = graph.add_place(94.0)
    assert late == 1
    assert graph.ways_from(100.0).tolist() == [0.5, 0.5 + 6.5]


def test_memory_grows_with_the_places_not_with_the_rounds():
    graph = DriftGraph()
    for place in range(10):
        graph.add_place(4.0 * place)
    for travelled in range(40, 40040, 4):
        graph.meet(travelled // 4 % 10, float(travelled))
    assert len(graph._edges) == 10
    assert graph.ways_from(40036.0).max() <= 0.5 + 5 * 5.0
