"""What the maps say of a place that is right, and of one that chance found."""

from dataclasses import replace

from merging.verification import Evidence, Pieces

GOOD = Evidence(
    overlap_m2=50.0, compared_wall_m=50.0, agreed_wall_m=44.0, conflicting_wall_m=2.0, unseen_wall_m=1.0,
    weakest_wall_m=20.0, rmse_m=0.03, agreement=0.88, conflict=0.04, larger_wall_m=120.0, seen_through_m=0.0,
    agreed_things_m=3.0, compared_things_m=6.0, pieces=Pieces(45.0, 2.0, 55.0, 20.0),
)  # fmt: skip
CHANCE = replace(
    GOOD, compared_wall_m=13.0, agreed_wall_m=5.0, conflicting_wall_m=4.0, weakest_wall_m=1.5, agreement=0.38,
    conflict=0.31, rmse_m=0.08, pieces=Pieces(6.0, 5.0, 20.0, 2.0),
)  # fmt: skip
