"""Scores of a trajectory against a true trajectory or true relations, and of a map against a map or simulated world."""

import argparse
import dataclasses
import logging
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from datasets.synthetic.world.world import World, WorldError, load_world
from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_probability
from tbmslam.belief.grid_resampling import canvas_of, resample
from tbmslam.belief.masses import OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.error_pictures import Backdrop, draw_map_errors, draw_trajectory_errors
from tbmslam.evaluation.map_agreement import Labels, cell_labels, map_agreement, refine_map_transform
from tbmslam.evaluation.relation_cycles import relation_noise
from tbmslam.evaluation.relations import read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import (
    ErrorStatistics,
    align_trajectories,
    relative_errors,
    remedy_of,
    systematic_error,
)
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_bytes
from tbmslam.io.map_folder import load_map
from tbmslam.io.pictures import encode_png
from tbmslam.io.trajectory_file import ReferenceTrajectory, read_reference, read_tum
from tbmslam.map.map_check import MapFileError
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.paths import holds_map

logger = logging.getLogger(__name__)

_MOST_TURN = math.radians(20.0)  # largest rotation of a map relative to the stated pose for --align


def evaluate_trajectory(args: argparse.Namespace) -> dict[str, object]:
    """Evaluate a trajectory as the arguments request; return the figures."""
    estimate = read_tum(args.estimate)
    if args.relations:
        return _against_relations(args, estimate)
    return _against_truth(args, estimate)


def _against_truth(args: argparse.Namespace, estimate: Trajectory) -> dict[str, object]:
    reference = read_reference(args.truth)
    if args.frame is not None:
        reference = dataclasses.replace(reference, frame=args.frame)
    truth = _true_trajectory(reference, args.truth, args.estimate, args.sensor_pose)
    tolerance = 0.01 if args.max_stamp_difference is None else args.max_stamp_difference
    if (error := systematic_error(truth, estimate, tolerance)) is not None:
        try:
            mount = _mount(args.estimate, args.sensor_pose)
        except TbmSlamError:  # a damaged map beside the estimate, which the figures do not need
            mount = None
        remedy = remedy_of(error, truth, estimate, tolerance, reference.frame, mount)
        logger.warning("%s: %s: %s", args.truth, error.fact, remedy)
    absolute = align_trajectories(truth, estimate, tolerance)
    step_m = args.step_m or (None if args.step_s else 1.0)
    relative = relative_errors(truth, estimate, distance=step_m, seconds=args.step_s, max_stamp_difference=tolerance)
    if args.picture:
        beneath = _backdrop(args.map, absolute.T_reference_estimate) if args.map else None
        picture = draw_trajectory_errors(absolute.points, absolute.errors_m, beneath)
        write_bytes(args.picture, encode_png(picture))
    return {
        "estimate": str(args.estimate),
        "truth": str(args.truth),
        "frame": reference.frame,
        "poses": len(estimate),
        "unmatched": absolute.unmatched,
        "T_truth_estimate": _pose_figures(absolute.T_reference_estimate),
        "ate_m": _statistics(absolute.errors_m),
        "rpe": {
            "step": f"{step_m:g} m" if step_m else f"{args.step_s:g} s",
            "steps": len(relative.translations_m),
            "translation_m": _statistics(relative.translations_m),
            "rotation_deg": _statistics(relative.rotations_deg),
        },
    }


def _against_relations(args: argparse.Namespace, estimate: Trajectory) -> dict[str, object]:
    tolerance = 0.001 if args.max_stamp_difference is None else args.max_stamp_difference
    relations = read_relations(args.relations)
    errors = relation_errors(relations, estimate, tolerance)
    if not len(errors.translations_m):
        raise TbmSlamError(
            f"{args.estimate}: none of the {errors.unmatched} relations of {args.relations} has poses at both of its "
            "stamps: check that both are of the same recording, or raise --max-stamp-difference"
        )
    if args.picture:
        beneath = _backdrop(args.map, SE2.identity()) if args.map else None
        points = estimate.poses[errors.pairs[:, 1], :2]
        picture = draw_trajectory_errors(points, errors.translations_m, beneath)
        write_bytes(args.picture, encode_png(picture))
    noise = relation_noise(relations)
    return {
        "estimate": str(args.estimate),
        "relations": str(args.relations),
        "poses": len(estimate),
        "checked": len(errors.translations_m),
        "unmatched": errors.unmatched,
        "translation_m": _statistics(errors.translations_m),
        "rotation_deg": _statistics(errors.rotations_deg),
        "relation_noise": None if noise is None else noise._asdict(),
    }


def _statistics(errors: FloatArray) -> dict[str, float]:
    return dataclasses.asdict(ErrorStatistics.of(errors))


def _backdrop(path: Path, T_drawn_map: SE2) -> Backdrop:
    """Return walls for the plot of a trajectory; a world is already in the truth's frame."""
    truth = _load_truth(path)
    if isinstance(truth, World):
        return Backdrop(*_own_labels(truth, 0.05, 0.0))
    grid = resample(truth, T_drawn_map, canvas_of(truth.geometry, T_drawn_map))
    return Backdrop(cell_labels(grid), grid.geometry)


def evaluate_map(args: argparse.Namespace) -> dict[str, object]:
    """Evaluate a map as the arguments request; return the figures."""
    grid = load_map(args.map).grid
    truth = _load_truth(args.truth)
    labels = cell_labels(grid, args.min_evidence)
    T_truth_map = _given_transform(args)
    confidence = None
    if args.align is not None:
        T_truth_map, confidence = _aligned(args, grid, truth, T_truth_map)
    if args.refine or args.align is not None:
        true_labels, true_geometry = _own_labels(truth, grid.geometry.resolution, args.min_evidence)
        T_truth_map = refine_map_transform(labels, grid.geometry, true_labels, true_geometry, T_truth_map)
    true_labels = _labels_at(truth, grid.geometry, T_truth_map, args.min_evidence)
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
        "T_truth_map": _pose_figures(T_truth_map),
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
        truth = _true_trajectory(read_reference(true_path), true_path, path, None)
        return align_trajectories(truth, read_tum(path)).T_reference_estimate
    return SE2.identity()


def _true_trajectory(
    reference: ReferenceTrajectory, path: Path, estimate: Path, sensor_pose: Sequence[float] | None
) -> Trajectory:
    """Return the true trajectory of the robot; the mount of the laser is given or in the map beside the estimate."""
    if reference.frame == "robot":
        return reference.trajectory
    T_robot_sensor = _mount(estimate, sensor_pose)
    if T_robot_sensor is not None:
        return reference.of_robot(T_robot_sensor)
    raise TbmSlamError(
        f"{path} holds poses of the laser, and no map with keyframes beside {estimate} states its mounting: pass "
        "--sensor-pose X Y DEG"
    )


def _mount(estimate: Path, sensor_pose: Sequence[float] | None) -> SE2 | None:
    """Return the stated mount of the laser, or that of the map beside an estimate; None if unknown."""
    if sensor_pose is not None:
        x, y, degrees = sensor_pose
        return SE2(x, y, math.radians(degrees))
    if holds_map(estimate.parent):
        drives = load_map(estimate.parent).drives
        if drives and len(drives[0].keyframes):
            return drives[0].keyframes.mounting()
    return None


def _load_truth(path: Path) -> World | TbmGrid:
    """Read a world or a map: both may be .npz."""
    if path.suffix == ".npz" and path.is_file():
        try:
            return load_world(path)
        except WorldError as error:
            no_world = error
        try:
            return load_map(path).grid
        except MapFileError as error:
            raise TbmSlamError(f"{error}; and {no_world}") from None
    return load_map(path).grid


def _own_labels(truth: World | TbmGrid, resolution: float, min_evidence: float) -> tuple[Labels, GridGeometry]:
    """Return the true labels on the cells of the truth; those of a world have the given size."""
    if isinstance(truth, TbmGrid):
        return cell_labels(truth, min_evidence), truth.geometry
    geometry = truth.grid(resolution)
    return truth.occupancy(geometry), geometry


def _labels_at(truth: World | TbmGrid, geometry: GridGeometry, T_truth_map: SE2, min_evidence: float) -> Labels:
    """Return the true labels on the cells of a map at T_truth_map."""
    if isinstance(truth, TbmGrid):
        return cell_labels(resample(truth, T_truth_map.inverse(), geometry), min_evidence)
    return truth.occupancy(geometry, T_truth_map)


def _pose_figures(pose: SE2) -> dict[str, float]:
    """Return a pose as figures [m, deg]."""
    return {"x_m": pose.x, "y_m": pose.y, "theta_deg": math.degrees(pose.theta)}
