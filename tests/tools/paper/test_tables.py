"""What the report concludes is counted in the run."""

import numpy as np

from tools.paper.detectors import AS_PROGRAMMED, AS_WRITTEN, MODIFICATIONS, Setting, Study
from tools.paper.tables import conclusions


def study(better, sure):
    """Five settings in which one modification is above all others, in some of them by far more than the spread."""
    spread = 0.1 * np.sin(np.arange(10.0))
    shares = {}
    for k in range(5):
        for letter in MODIFICATIONS:
            gain = (0.3 if k < sure else 1e-6) if letter == better else 0.0
            shares[Setting(100 * (k + 1), 0.7, letter)] = 0.5 + spread * (1.0 if letter == better else -1.0) + gain
    return Study(shares=shares, matches={}, found={})


def test_only_pairs_with_matches_of_both_joins_are_compared():
    """(e) is worse in each pair where both have matches; only its other pair has a high share."""
    shares = {letter: np.array([0.5, 0.6, np.nan]) for letter in MODIFICATIONS}
    shares["e"] = np.array([0.4, 0.5, 1.0])
    settings = {Setting(100, 0.7, letter): values for letter, values in shares.items()}
    one = Study(shares=settings, matches={}, found={})
    assert conclusions(Results(one, one))[0] == ("as written", (0, 0, 1), (0, 0, 1))


class Results:
    def __init__(self, written, programmed):
        self.studies = {AS_WRITTEN: written, AS_PROGRAMMED: programmed}


def test_settings_are_counted_in_which_a_join_is_better():
    written, programmed = conclusions(Results(study("e", 3), study("b", 2)))
    assert written == ("as written", (5, 3, 5), (0, 0, 5))
    assert programmed == ("as programmed", (0, 0, 5), (5, 2, 5))
