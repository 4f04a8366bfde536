"""The confidence model: its fit to pairs of maps with known truth, and its calibration as a table and a plot."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from scipy import optimize
from scipy.stats import binomtest

from merging.config import MergeConfig
from merging.nonrigid.deformation import DeformableMap
from merging.nonrigid.hypotheses import DeformedPoses
from merging.nonrigid.search import DeformedRivals, first_apart
from merging.registration.correlation import find_candidates, propose
from merging.rigid_alignment import prepared
from merging.scoring import MEASURES, SIGNS, ConfidenceModel, by_chance, features, find_decoys, measured
from merging.verification import Evidence
from merging.walls import WallMap, without_walls
from tbmslam.geometry.se2 import BoolArray, FloatArray
from tbmslam.io.pictures import encode_png
from tbmslam.parallel.executor import Call, Executor
from tools.command_line.text_table import text_table
from tools.map_pairs import KnownPair, floors_of

BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0)
"""Edges of the bins of confidence."""

_THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Judgement:
    """The best pose of a pair by a model."""

    name: str
    confidence: float
    """Confidence of the most probable pose; 0 without a pose."""
    right: bool
    """Whether this pose is the true one."""


class Judged(Protocol):
    """An answer with a confidence."""

    @property
    def confidence(self) -> float:
        """The probability that the answer is right."""

    @property
    def right(self) -> bool:
        """Whether the answer is right."""


def acceptance_table(judged: Sequence[Judgement]) -> str:
    """Return a table of correctly accepted pairs by overlap, and of false accepts, for several thresholds."""
    crops = [item for item in judged if item.name.startswith("crop")]
    others = [item for item in judged if not item.name.startswith("crop")]
    overlaps = sorted({item.name[-3:] for item in crops}, reverse=True)
    rows = []
    for least in _THRESHOLDS:
        cells = []
        for overlap in overlaps:
            mine = [item for item in crops if item.name.endswith(overlap)]
            cells.append(f"{sum(one.right and one.confidence >= least for one in mine)}/{len(mine)}")
        wrong = sum(not item.right and item.confidence >= least for item in crops)
        false = sum(item.confidence >= least for item in others)
        rows.append([f"{least:.1f}", *cells, str(wrong), f"{false} of {len(others)}"])
    head = ["least confidence", *(f"{int(overlap)} %" for overlap in overlaps), "wrong", "negatives"]
    return text_table(head, rows)


def _bins(judged: Sequence[Judged], edges: Sequence[float]) -> Iterator[tuple[float, float, float, int, int]]:
    """Yield the bounds and the mean of confidence, the right answers and all answers of each bin that has any."""
    for low, high in itertools.pairwise(edges):
        inside = [item for item in judged if low <= item.confidence < high or high == item.confidence == edges[-1]]
        if inside:
            given = float(np.mean([item.confidence for item in inside]))
            yield low, high, given, sum(item.right for item in inside), len(inside)


def calibration_table(judged: Sequence[Judged], edges: Sequence[float]) -> str:
    """Return a table of the share of right answers in bins of confidence."""
    rows = [
        [f"{low:.2f} to {high:.2f}", str(pairs), f"{given:.3f}", f"{right / pairs:.3f}"]
        for low, high, given, right, pairs in _bins(judged, edges)
    ]
    return text_table(["confidence", "pairs", "given, mean", "right, share"], rows)


_SIZE, _MARGIN = 480, 60
_BLACK, _GREY, _BLUE = (0, 0, 0), (190, 190, 190), (178, 114, 0)


def draw_calibration(judged: Sequence[Judged], edges: Sequence[float]) -> bytes:
    """Return a PNG with a dot for each bin of confidence: its share of right answers with the 95 % interval."""
    picture = np.full((_SIZE + 2 * _MARGIN, _SIZE + 2 * _MARGIN, 3), 255, dtype=np.uint8)
    cv2.rectangle(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _BLACK, 1)
    cv2.line(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _GREY, 1, cv2.LINE_AA)
    for tick in (0.0, 0.5, 1.0):
        _write(picture, f"{tick:g}", (_pixel(tick, 0.0)[0] - 8, _SIZE + _MARGIN + 22))
        _write(picture, f"{tick:g}", (_MARGIN - 38, _pixel(0.0, tick)[1] + 5))
    _write(picture, "confidence given", (_MARGIN + _SIZE // 2 - 70, _SIZE + _MARGIN + 45))
    _write(picture, "share that is right", (_MARGIN, _MARGIN - 15))
    for _, _, given, right, pairs in _bins(judged, edges):
        interval = binomtest(right, pairs).proportion_ci(method="wilson")
        x, y = _pixel(given, right / pairs)
        cv2.line(picture, _pixel(given, interval.low), _pixel(given, interval.high), _BLUE, 1, cv2.LINE_AA)
        cv2.circle(picture, (x, y), 5, _BLUE, -1, cv2.LINE_AA)
        _write(picture, str(pairs), (x + 8, y + 14))
    return encode_png(picture)


def _pixel(x: float, y: float) -> tuple[int, int]:
    return round(_MARGIN + x * _SIZE), round(_MARGIN + (1.0 - y) * _SIZE)


def _write(picture: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _BLACK, 1, cv2.LINE_AA)


_PENALTY = 0.001
"""Penalty on the squared weights of standardised features, per pair."""
_MOST_PARTS = 12
"""Largest number of parts of the cross validation over buildings."""
_F = len(SIGNS)
_SIGNS = [*SIGNS.values(), *(item.sign for item in MEASURES.values())]


@dataclass(frozen=True)
class Trial:
    """The evidence for the poses of one pair, and the truth."""

    name: str
    candidates: Sequence[Evidence]
    decoys: Sequence[Evidence]
    """Evidence for each candidate pose (K,), and for poses of the mirror image."""
    right: BoolArray
    """Whether each candidate (K,) is right."""
    near: BoolArray
    """Whether each candidate (K,) is near the true pose, with a larger tolerance of rotation. The model is fitted to
    these, since it distinguishes places and not the accuracy of their poses."""
    weight: float = 1.0
    """Weight of the pair in the fit."""

    @classmethod
    def of(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Search the candidate poses of a pair; None if one of its maps is empty."""
        target, source = (
            prepared(item.grid, item.grid.geometry.resolution, config) for item in (pair.target, pair.source)
        )
        if target is None or source is None:
            return None
        turned = source.structure.wall_m > target.structure.wall_m  # as in the alignment
        staying, moving = (source, target) if turned else (target, source)
        found = find_candidates(staying.structure, moving.structure, config)
        decoys = find_decoys(staying.structure, moving.structure, config)
        motions = [motion.inverse() if turned else motion for motion, _ in found]
        right, near = (np.array([of(motion) for motion in motions], np.bool_) for of in (pair.is_right, pair.is_near))
        return cls(pair.name, [evidence for _, evidence in found], decoys, right, near, weight)

    @classmethod
    def of_deformed(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Deform one map of a pair at its most likely pose and at the rivals; None if it fits nowhere."""
        structures = [WallMap.from_grid(item.grid, config.structure) for item in (pair.target, pair.source)]
        if not all(item.grid.is_known().any() for item in (pair.target, pair.source)) or without_walls(*structures):
            return None
        moving = 0 if structures[0].wall_m < structures[1].wall_m else 1  # as in the alignment
        target, grid = structures[1 - moving], (pair.target, pair.source)[moving].grid
        source = DeformableMap.of(grid, config, structures[moving])
        proposals = propose(target, source.structure, config.correlation).motions
        poses = DeformedPoses(target, source, config)
        likeliest = poses.likeliest(first_apart(proposals, source.structure, config.nonrigid.places), ())
        if likeliest is None:
            return None
        rivals = DeformedRivals.of(poses, likeliest[1], proposals)
        near = np.array([pair.is_near(pose if moving == 1 else pose.inverse()) for pose in rivals.motions], np.bool_)
        return cls(pair.name, rivals.evidence, rivals.decoys, near, near, weight)

    def judged(self, model: ConfidenceModel) -> Judgement:
        """Return the best pose by a model."""
        p = model.probabilities(self.candidates, self.decoys)
        if len(p) == 0:
            return Judgement(self.name, 0.0, right=False)
        return Judgement(self.name, float(p.max()), bool(self.right[int(p.argmax())]))

    @cached_property
    def numbers(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Features (K, F) and measures (K, M) of the candidates, and measures (D, M) of the decoys."""
        return features(self.candidates, self.decoys), measured(self.candidates), measured(self.decoys)


def fit_model(trials: Sequence[Trial]) -> ConfidenceModel:
    """Return the model of maximum likelihood with a quadratic penalty on its weights."""
    everything = np.vstack([np.hstack(item.numbers[:2]) for item in trials])
    strength = _PENALTY * sum(item.weight for item in trials) * (everything.std(axis=0) + 1e-9) ** 2

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        model = ConfidenceModel(parameters[1 + _F :], float(parameters[0]), parameters[1 : 1 + _F])
        value, slope = float(strength @ parameters[1:] ** 2), np.append(0.0, 2.0 * strength * parameters[1:])
        for item in trials:
            surprise, of_it = _surprise(item, model)
            value, slope = value + item.weight * surprise, slope + item.weight * of_it
        return value, slope

    begin = np.array([-3.0, *(0.5 * sign for sign in _SIGNS)])
    bounds = [(None, None), *((0.0 if sign > 0 else None, 0.0 if sign < 0 else None) for sign in _SIGNS)]
    found = optimize.minimize(loss, begin, jac=True, method="L-BFGS-B", bounds=bounds).x
    return ConfidenceModel(found[1 + _F :], float(found[0]), found[1 : 1 + _F])


def _surprise(trial: Trial, model: ConfidenceModel) -> tuple[float, FloatArray]:
    """Return the negative log likelihood of the truth, and its gradient (1 + F + M,) by bias and weights."""
    own_features, own, decoys = trial.numbers
    beyond = own - by_chance(own, decoys, model.score)
    logits = np.append(own_features @ model.weights + beyond @ model.score + model.bias, 0.0)
    shares = np.exp(logits - logits.max())
    shares /= shares.sum()
    true = np.append(trial.near, not trial.near.any())
    likely = max(float(shares @ true), 1e-300)
    change = (shares - shares * true / likely)[:-1]
    return -float(np.log(likely)), np.concatenate(([change.sum()], change @ own_features, change @ beyond))


def held_out(trials: Sequence[Trial], executor: Executor) -> list[Judgement]:
    """Return the best pose of each pair by a model that was fitted without its building, or the first of two."""
    shown = floors_of(item.name for item in trials)
    floors = sorted({floor for some in shown.values() for floor in some})
    parts = [set(floors[part::_MOST_PARTS]) for part in range(min(_MOST_PARTS, len(floors)))]
    used = [[item for item in trials if not shown[item.name] & part] for part in parts]
    models = executor.results([Call(str(number), fit_model, (some,)) for number, some in enumerate(used)])
    judged = []
    for item in trials:
        first = min(shown[item.name], default=floors[0])
        model = next(model for part, model in zip(parts, models, strict=True) if first in part)
        judged.append(item.judged(model))
    return judged
