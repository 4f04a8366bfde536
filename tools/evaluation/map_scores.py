"""The agreement of a map with a true map or a simulated world."""

import argparse
import dataclasses
import math

import numpy as np

from datasets.synthetic.world.world import World
from tbmslam.belief.grid import TbmGrid, masses_from_probability
from tbmslam.belief.masses import OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.error_pictures import draw_map_errors
from tbmslam.evaluation.map_agreement import cell_labels, map_agreement, refine_map_transform
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.io.atomic_file import write_bytes
from tbmslam.io.map_folder import load_map
from tbmslam.io.pictures import encode_png
from tbmslam.io.trajectory_file import read_reference, read_tum
from tbmslam.map.tbm_map import TbmMap
from tools.evaluation.truth import labels_at, load_truth, own_labels, pose_figures, true_trajectory

_MOST_TURN = math.radians(20.0)
"""Largest rotation of a map relative to the stated pose for --align."""


def evaluate_map(args: argparse.Namespace) -> dict[str, object]:
    """Evaluate a map as the arguments request; return the figures."""
    grid = load_map(args.map).grid
    truth = load_truth(args.truth)
    labels = cell_labels(grid, args.min_evidence)
    T_truth_map = _given_transform(args)
    confidence = None
    if args.align is not None:
        T_truth_map, confidence = _aligned(args, grid, truth, T_truth_map)
    if args.refine or args.align is not None:
        true_labels, true_geometry = own_labels(truth, grid.geometry.resolution, args.min_evidence)
        T_truth_map = refine_map_transform(labels, grid.geometry, true_labels, true_geometry, T_truth_map)
    true_labels = labels_at(truth, grid.geometry, T_truth_map, args.min_evidence)
    agreement = map_agreement(labels, true_labels)
    if not agreement.known_both:
        raise TbmSlamError(
            f"{args.map} and {args.truth} have no common known cell: set the pose of the map with --transform X Y DEG"
        )
    if args.picture:
        write_bytes(args.picture, encode_png(draw_map_errors(labels, true_labels)))
    figures = dataclasses.asdict(agreement)
    wall_distance = figures.pop("wall_distance")
    return {
        "map": str(args.map),
        "truth": str(args.truth),
        "T_truth_map": pose_figures(T_truth_map),
        "refined": args.refine or args.align is not None,
        **({} if confidence is None else {"confidence": confidence}),
        **{name: None if math.isnan(value) else value for name, value in figures.items()},
        "wall_distance_m": None if math.isnan(wall_distance) else wall_distance * grid.geometry.resolution,
    }


def _aligned(args: argparse.Namespace, grid: TbmGrid, truth: World | TbmGrid, guess: SE2) -> tuple[SE2, float]:
    """Return the pose of a map in the truth near a guess, and its probability, by the walls of both."""
    from merging import MergeConfig, align

    whole = truth if isinstance(truth, TbmGrid) else _grid_of(truth, grid.geometry.resolution)
    found = align(TbmMap(whole), TbmMap(grid), MergeConfig(method="correlation"))
    if found.T_target_source is None:
        raise TbmSlamError(f"{args.map} cannot be aligned with {args.truth}: {found.reason}: pass --transform X Y DEG")
    middle = grid.geometry.centre_of(grid.geometry.rows / 2.0, grid.geometry.cols / 2.0)
    near, far = list[tuple[SE2, float]](), 0.0
    for hypothesis in found.hypotheses():
        place, probability = hypothesis.T_target_source, hypothesis.confidence
        apart = math.dist(place.apply(middle), guess.apply(middle))
        if apart <= args.align and abs(wrap_angle(place.theta - guess.theta)) <= _MOST_TURN:
            near.append((place, probability))
        else:
            far += probability
    best, probability = max(near, key=lambda candidate: candidate[1], default=(guess, 0.0))
    confidence = probability / max(1.0 - far, probability, 1e-9)  # other poses are excluded
    if confidence < MergeConfig().verification.min_confidence:
        x, y, theta = found.T_target_source
        raise TbmSlamError(
            f"{args.map}: its pose on {args.truth} within {args.align:g} m and {math.degrees(_MOST_TURN):g} "
            f"degrees of the stated pose is uncertain, confidence {confidence:.2f}; it fits best at "
            f"{x:.2f} {y:.2f} {math.degrees(theta):.1f}, confidence {found.confidence:.2f}: "
            "pass --transform X Y DEG, or check that it is of this floor"
        )
    return best, confidence


def _grid_of(world: World, resolution: float) -> TbmGrid:
    geometry = world.grid(resolution)
    labels = world.occupancy(geometry)
    return TbmGrid(geometry, masses_from_probability(np.where(labels == OCCUPIED, 1.0, 0.0), labels != UNKNOWN))


def _given_transform(args: argparse.Namespace) -> SE2:
    if args.transform:
        x, y, degrees = args.transform
        return SE2(x, y, math.radians(degrees))
    if args.trajectories:
        path, true_path = args.trajectories
        truth = true_trajectory(read_reference(true_path), true_path, path, None)
        return align_trajectories(truth, read_tum(path)).T_reference_estimate
    return SE2.identity()
