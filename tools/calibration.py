"""The confidence model: its fit to pairs of maps with known truth, and its calibration as a table and a plot."""

import itertools
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt
from scipy import optimize

from merging.config import MergeConfig
from merging.nonrigid.search import DeformedRivals
from merging.nonrigid.tile_registration import DeformableMap, deform
from merging.registration.correlation import propose
from merging.registration.hypotheses import find_candidates
from merging.rigid_alignment import prepared
from merging.scoring.confidence import MEASURES, SIGNS, ConfidenceModel, by_chance, features, measured
from merging.scoring.decoys import find_decoys
from merging.verification.evidence import Evidence
from merging.walls.wall_map import WallMap, without_walls
from tbmslam.geometry.se2 import FloatArray
from tbmslam.io.pictures import encode_png
from tools.command_line.text_table import text_table
from tools.map_pairs import KnownPair, floors_of

BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0)
"""Edges of the confidences that are put together."""

_THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Judgement:
    """What a model says of a pair: its best place's confidence, and whether that place is the true one.

    Parameters
    ----------
    name
        The pair.
    confidence
        Of its likeliest place; 0 where there is none.
    right
        Whether that is the truth.
    """

    name: str
    confidence: float
    right: bool


class Judged(Protocol):
    """Anything with a confidence that was right or wrong."""

    @property
    def confidence(self) -> float:
        """What was promised."""

    @property
    def right(self) -> bool:
        """What came of it."""


def worth(judged: Sequence[Judgement]) -> str:
    """Return a table of what is accepted rightly, by overlap, and wrongly, at several least confidences."""
    crops = [one for one in judged if one.name.startswith("crop")]
    others = [one for one in judged if not one.name.startswith("crop")]
    overlaps = sorted({one.name[-3:] for one in crops}, reverse=True)
    rows = []
    for least in _THRESHOLDS:
        cells = []
        for overlap in overlaps:
            mine = [one for one in crops if one.name.endswith(overlap)]
            cells.append(f"{sum(one.right and one.confidence >= least for one in mine)}/{len(mine)}")
        wrong = sum(not one.right and one.confidence >= least for one in crops)
        false = sum(one.confidence >= least for one in others)
        rows.append([f"{least:.1f}", *cells, str(wrong), f"{false} of {len(others)}"])
    head = ["least confidence", *(f"{int(overlap)} %" for overlap in overlaps), "wrong", "negatives"]
    return text_table(head, rows)


def calibration_table(judged: Sequence[Judged], edges: Sequence[float]) -> str:
    """Return how many of the best places are right, by the confidence that they were given, in bins."""
    rows = []
    for low, high in itertools.pairwise(edges):
        inside = [one for one in judged if low <= one.confidence < high or high == one.confidence == edges[-1]]
        if inside:
            given = float(np.mean([one.confidence for one in inside]))
            share = sum(one.right for one in inside) / len(inside)
            rows.append([f"{low:.2f} to {high:.2f}", str(len(inside)), f"{given:.3f}", f"{share:.3f}"])
    return text_table(["confidence", "pairs", "given, mean", "right, share"], rows)


_SIZE, _MARGIN = 480, 60
_BLACK, _GREY, _BLUE = (0, 0, 0), (190, 190, 190), (178, 114, 0)


def draw_calibration(judged: Sequence[tuple[float, bool]], edges: Sequence[float]) -> bytes:
    """Return a PNG: the diagonal, and for each bin of confidence a dot with the 95 % interval of the share right.

    Parameters
    ----------
    judged
        Confidence, and whether the answer was right.
    edges
        Of the bins, rising from 0 to 1.
    """
    picture = np.full((_SIZE + 2 * _MARGIN, _SIZE + 2 * _MARGIN, 3), 255, dtype=np.uint8)
    cv2.rectangle(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _BLACK, 1)
    cv2.line(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _GREY, 1, cv2.LINE_AA)
    for tick in (0.0, 0.5, 1.0):
        _write(picture, f"{tick:g}", (_pixel(tick, 0.0)[0] - 8, _SIZE + _MARGIN + 22))
        _write(picture, f"{tick:g}", (_MARGIN - 38, _pixel(0.0, tick)[1] + 5))
    _write(picture, "confidence given", (_MARGIN + _SIZE // 2 - 70, _SIZE + _MARGIN + 45))
    _write(picture, "share that is right", (_MARGIN, _MARGIN - 15))
    for low, high in itertools.pairwise(edges):
        inside = [(p, right) for p, right in judged if low <= p < high or (high == edges[-1] and p == high)]
        if inside:
            given = float(np.mean([p for p, _ in inside]))
            share, least, most = _wilson(sum(right for _, right in inside), len(inside))
            cv2.line(picture, _pixel(given, least), _pixel(given, most), _BLUE, 1, cv2.LINE_AA)
            cv2.circle(picture, _pixel(given, share), 5, _BLUE, -1, cv2.LINE_AA)
            _write(picture, str(len(inside)), (_pixel(given, share)[0] + 8, _pixel(given, share)[1] + 14))
    return encode_png(picture)


def _wilson(right: int, count: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson 1927)."""
    share, z = right / count, 1.96
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    reach = z * float(np.sqrt(share * (1 - share) / count + z * z / (4 * count * count))) / (1 + z * z / count)
    return share, max(middle - reach, 0.0), min(middle + reach, 1.0)


def _pixel(x: float, y: float) -> tuple[int, int]:
    return round(_MARGIN + x * _SIZE), round(_MARGIN + (1.0 - y) * _SIZE)


def _write(picture: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _BLACK, 1, cv2.LINE_AA)


BoolArray = npt.NDArray[np.bool_]

_PENALTY = 0.001
"""On the squares of the weights of standardised numbers, by pair."""
_MOST_PARTS = 12
"""The buildings are left out in so many parts, one by one where there are no more."""
_F = len(SIGNS)
_SIGNS = [*SIGNS.values(), *(one.sign for one in MEASURES.values())]


@dataclass(frozen=True)
class Trial:
    """What the aligner weighs of one pair, and what is true.

    Parameters
    ----------
    name
        The pair.
    candidates, decoys
        What speaks for and against each place, and the places of the mirror image.
    right
        Which candidates (K,) are the truth; none where no candidate is.
    near
        Which candidates (K,) lie where the truth does, be they turned a little too far. It is they that a fit learns
        from: what to tell apart are places, not how exactly they were met.
    weight
        How many usual pairs this one counts for.
    """

    name: str
    candidates: Sequence[Evidence]
    decoys: Sequence[Evidence]
    right: BoolArray
    near: BoolArray
    weight: float = 1.0

    @classmethod
    def of(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Search a pair for places; None where one of its maps is empty."""
        target, source = (
            prepared(one.grid, one.grid.geometry.resolution, config) for one in (pair.target, pair.source)
        )
        if target is None or source is None:
            return None
        turned = source.structure.wall_m > target.structure.wall_m  # as the aligner does
        staying, moving = (source, target) if turned else (target, source)
        found = find_candidates(staying.structure, moving.structure, config)
        decoys = find_decoys(staying.structure, moving.structure, config)
        motions = [motion.inverse() if turned else motion for motion, _ in found]
        right, near = (np.array([of(motion) for motion in motions], np.bool_) for of in (pair.is_right, pair.is_near))
        return cls(pair.name, [evidence for _, evidence in found], decoys, right, near, weight)

    @classmethod
    def of_deformed(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Deform one map of a pair at the place that looks best and at its rivals; None where hardly any of it fits."""
        structures = [WallMap.from_grid(one.grid, config.structure) for one in (pair.target, pair.source)]
        if not all(one.grid.is_known().any() for one in (pair.target, pair.source)) or without_walls(*structures):
            return None
        moving = 0 if structures[0].wall_m < structures[1].wall_m else 1  # as the aligner does
        target, grid = structures[1 - moving], (pair.target, pair.source)[moving].grid
        source = DeformableMap.of(grid, config, structures[moving])
        proposals = propose(target, source.structure, config.correlation).motions
        laid = deform(target, source, proposals[0], config)
        if laid is None:
            return None
        places = DeformedRivals.of(target, source, laid.motion, proposals, config)
        near = np.array([pair.is_near(one if moving == 1 else one.inverse()) for one in places.motions], np.bool_)
        return cls(pair.name, places.evidence, places.decoys, near, near, weight)

    def judged(self, model: ConfidenceModel) -> Judgement:
        """Return what a model says of it."""
        p = model.probabilities(self.candidates, self.decoys)
        if len(p) == 0:
            return Judgement(self.name, 0.0, right=False)
        return Judgement(self.name, float(p.max()), bool(self.right[int(p.argmax())]))

    @cached_property
    def numbers(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Features (K, F) and measures (K, M) of the candidates, and measures (D, M) of the decoys."""
        return features(self.candidates, self.decoys), measured(self.candidates), measured(self.decoys)


def fit_model(trials: Sequence[Trial]) -> ConfidenceModel:
    """Return the model of greatest likelihood, less a penalty on the squares of its weights."""
    everything = np.vstack([np.hstack(one.numbers[:2]) for one in trials])
    strength = _PENALTY * sum(one.weight for one in trials) * (everything.std(axis=0) + 1e-9) ** 2

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        model = ConfidenceModel(parameters[1 + _F :], float(parameters[0]), parameters[1 : 1 + _F])
        value, slope = float(strength @ parameters[1:] ** 2), np.append(0.0, 2.0 * strength * parameters[1:])
        for one in trials:
            surprise, of_it = _surprise(one, model)
            value, slope = value + one.weight * surprise, slope + one.weight * of_it
        return value, slope

    begin = np.array([-3.0, *(0.5 * sign for sign in _SIGNS)])
    bounds = [(None, None), *((0.0 if sign > 0 else None, 0.0 if sign < 0 else None) for sign in _SIGNS)]
    found = optimize.minimize(loss, begin, jac=True, method="L-BFGS-B", bounds=bounds).x
    return ConfidenceModel(found[1 + _F :], float(found[0]), found[1 : 1 + _F])


def _surprise(trial: Trial, model: ConfidenceModel) -> tuple[float, FloatArray]:
    """Return minus the logarithm of the truth's probability, and its slopes (1 + F + M,) by bias and weights."""
    own_features, own, decoys = trial.numbers
    beyond = own - by_chance(own, decoys, model.score)
    logits = np.append(own_features @ model.weights + beyond @ model.score + model.bias, 0.0)
    shares = np.exp(logits - logits.max())
    shares /= shares.sum()
    true = np.append(trial.near, not trial.near.any())
    likely = max(float(shares @ true), 1e-300)
    change = (shares - shares * true / likely)[:-1]
    return -float(np.log(likely)), np.concatenate(([change.sum()], change @ own_features, change @ beyond))


def held_out(trials: Sequence[Trial], pool: Executor) -> list[Judgement]:
    """Return what is said of each pair by a model that never met its building, or the first of its two."""
    shown = floors_of(one.name for one in trials)
    floors = sorted({floor for some in shown.values() for floor in some})
    parts = [set(floors[part::_MOST_PARTS]) for part in range(min(_MOST_PARTS, len(floors)))]
    models = list(pool.map(fit_model, ([one for one in trials if not shown[one.name] & part] for part in parts)))
    judged = []
    for one in trials:
        first = min(shown[one.name], default=floors[0])
        model = next(model for part, model in zip(parts, models, strict=True) if first in part)
        judged.append(one.judged(model))
    return judged
