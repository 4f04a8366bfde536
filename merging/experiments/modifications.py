"""Table II and figure 3: the benefit of descriptors of the three masses, for several combinations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from merging.config.registration import Descriptor, FeatureConfig
from merging.experiments.detectors import Described, match_all
from merging.experiments.map_pair import MapPair
from merging.registration.features import ORB_EDGE, Channels, joined, orb_of
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray

MODIFICATIONS: Mapping[str, Descriptor] = {"a": "pignistic", "b": "concatenated", "c": "and", "d": "or", "e": "xor"}
"""The paper's letters."""


class Variant(NamedTuple):
    """Differences between the paper and its program."""

    bits: Literal[128, 256]
    """Length of the descriptor of an image: 128 in the paper, which is the first half of the 256 of OpenCV's ORB."""
    unknown: Literal["as it is", "inverted"]
    """Whether the third image shows the unknown mass, as in the paper, or is inverted, as in its program."""


AS_WRITTEN = Variant(128, "as it is")
AS_PROGRAMMED = Variant(256, "inverted")


class Setting(NamedTuple):
    """A row and a column of table II."""

    keypoints: int
    ratio: float
    modification: str


@dataclass(frozen=True)
class Study:
    """The measurements."""

    shares: dict[Setting, FloatArray] = field(default_factory=dict)
    """For every setting the share of right matches in each pair (P,); nan if nothing matched."""
    matches: dict[Setting, npt.NDArray[np.int64]] = field(default_factory=dict)
    """For every setting the number of matches in each pair (P,)."""
    found: dict[int, npt.NDArray[np.int64]] = field(default_factory=dict)
    """Numbers of keypoints found in each map (2 P,), by the requested number."""


_Keypoints = tuple[FloatArray, dict[str, npt.NDArray[np.uint8]]]


def compare_modifications(
    pairs: Sequence[MapPair],
    keypoints: Sequence[int],
    ratios: Sequence[float],
    variants: Sequence[Variant],
    tolerance_m: float,
    say: Callable[[str], None] = lambda _: None,
) -> dict[Variant, Study]:
    """Match all pairs with all numbers of keypoints, modifications and ratios.

    Parameters
    ----------
    tolerance_m
        Largest distance of a right match from its true position [m].
    """
    studies = {variant: Study() for variant in variants}
    for count in keypoints:
        say(f"{count} keypoints")
        found_by_name: dict[str, _Keypoints] = {}
        for pair in pairs:
            for name, grid in ((pair.target_name, pair.target), (pair.source_name, pair.source)):
                if name not in found_by_name:
                    found_by_name[name] = _keypoints_of(grid, count)
        for variant, study in studies.items():
            shares, matches = _measured(pairs, found_by_name, variant, ratios, tolerance_m)
            for (ratio, letter), values in shares.items():
                setting = Setting(count, ratio, letter)
                study.shares[setting] = np.array(values)
                study.matches[setting] = np.array(matches[ratio, letter])
            sides = [len(found_by_name[name][0]) for pair in pairs for name in (pair.target_name, pair.source_name)]
            study.found[count] = np.array(sides)
    return studies


def _measured(
    pairs: Sequence[MapPair],
    found_by_name: Mapping[str, _Keypoints],
    variant: Variant,
    ratios: Sequence[float],
    tolerance_m: float,
) -> tuple[dict[tuple[float, str], list[float]], dict[tuple[float, str], list[int]]]:
    shares: dict[tuple[float, str], list[float]] = {(r, m): [] for r in ratios for m in MODIFICATIONS}
    counts: dict[tuple[float, str], list[int]] = {(r, m): [] for r in ratios for m in MODIFICATIONS}
    for pair in pairs:
        for letter, how in MODIFICATIONS.items():
            target, source = (
                _described(found_by_name[name], how, variant) for name in (pair.target_name, pair.source_name)
            )
            everything = match_all(target, source)
            for ratio in ratios:
                kept = everything.clearer_than(ratio)
                shares[ratio, letter].append(kept.share_right(pair, tolerance_m))
                counts[ratio, letter].append(len(kept.ratios))
    return shares, counts


def _keypoints_of(grid: TbmGrid, count: int) -> _Keypoints:
    """Return the keypoints of a grid [m] and their descriptors in each image."""
    channels = Channels.from_grid(grid, border=ORB_EDGE + 1)
    images = {
        "pignistic": channels.pignistic,
        "occupied": channels.occupied,
        "free": channels.free,
        "as it is": channels.unknown,
        "inverted": np.asarray(255 - channels.unknown, dtype=np.uint8),
    }
    orb = orb_of(FeatureConfig(keypoints=count))
    keypoints = orb.detect(channels.pignistic, None)
    if not keypoints:
        return np.empty((0, 2)), {name: np.empty((0, 32), dtype=np.uint8) for name in images}
    described = {name: orb.compute(image, keypoints) for name, image in images.items()}
    points = channels.to_metres([keypoint.pt for keypoint in described["pignistic"][0]])
    return points, {name: np.asarray(found, dtype=np.uint8) for name, (_, found) in described.items()}


def _described(keypoints: _Keypoints, how: Descriptor, variant: Variant) -> Described:
    points, found = keypoints
    names = ["pignistic"] if how == "pignistic" else ["occupied", "free", variant.unknown]
    # ORB's tests are sorted by their additional information: the first are the best (Rublee 2011).
    return Described(points, joined([found[name][:, : variant.bits // 8] for name in names], how))
