"""The errors of a trajectory against a true trajectory or true relations."""

import argparse
import dataclasses
import logging
import math
from pathlib import Path

import numpy as np

from datasets.synthetic.world.world import World
from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.grid_resampling import resample
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.error_pictures import Backdrop, draw_trajectory_errors
from tbmslam.evaluation.map_agreement import cell_labels
from tbmslam.evaluation.relations import read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import ErrorStatistics, absolute_errors, relative_errors, systematic_error
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_bytes
from tbmslam.io.pictures import encode_png
from tbmslam.io.trajectory_file import read_reference, read_tum
from tools.evaluation.truth import load_truth, own_labels, pose_figures, true_trajectory

logger = logging.getLogger(__name__)


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
    truth = true_trajectory(reference, args.truth, args.estimate, args.sensor_pose)
    tolerance = 0.01 if args.max_stamp_difference is None else args.max_stamp_difference
    if (why := systematic_error(truth, estimate, tolerance)) is not None:
        logger.warning("%s: %s", args.truth, why)
    absolute = absolute_errors(truth, estimate, tolerance)
    step_m = args.step_m or (None if args.step_s else 1.0)
    relative = relative_errors(truth, estimate, distance=step_m, seconds=args.step_s, max_stamp_difference=tolerance)
    if args.picture:
        beneath = _backdrop(args.map, absolute.T_truth_estimate) if args.map else None
        picture = draw_trajectory_errors(absolute.points, absolute.errors_m, beneath)
        write_bytes(args.picture, encode_png(picture))
    return {
        "estimate": str(args.estimate),
        "truth": str(args.truth),
        "frame": reference.frame,
        "poses": len(estimate),
        "unmatched": absolute.unmatched,
        "T_truth_estimate": pose_figures(absolute.T_truth_estimate),
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
    errors = relation_errors(read_relations(args.relations), estimate, tolerance)
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
    return {
        "estimate": str(args.estimate),
        "relations": str(args.relations),
        "poses": len(estimate),
        "checked": len(errors.translations_m),
        "unmatched": errors.unmatched,
        "translation_m": _statistics(errors.translations_m),
        "rotation_deg": _statistics(errors.rotations_deg),
    }


def _statistics(errors: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> dict[str, float]:
    return dataclasses.asdict(ErrorStatistics.of(errors))


def _backdrop(path: Path, T_drawn_map: SE2) -> Backdrop:
    """Return walls for the plot of a trajectory; a world is already in the truth's frame."""
    truth = load_truth(path)
    if isinstance(truth, World):
        return Backdrop(*own_labels(truth, 0.05, 0.0))
    grid = resample(truth, T_drawn_map, _covering(truth.geometry, T_drawn_map))
    return Backdrop(cell_labels(grid), grid.geometry)


def _covering(geometry: GridGeometry, T_drawn_map: SE2) -> GridGeometry:
    """Return the geometry, along the axes, that contains a transformed grid."""
    min_x, min_y, max_x, max_y = geometry.bounds()
    corners = T_drawn_map.apply([(min_x, min_y), (min_x, max_y), (max_x, min_y), (max_x, max_y)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    cols, rows = (math.ceil(side) for side in (high - low) / geometry.resolution)
    return GridGeometry(geometry.resolution, float(low[0]), float(low[1]), rows, cols)
