"""All experiments of the paper on some pairs of maps."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

from merging import merge
from merging.config import PAPER, MergeConfig
from merging.config.registration import FeatureConfig
from merging.experiments.detectors import DetectorResult, compare_detectors
from merging.experiments.map_pair import Halves, MapPair, fuse_halves
from merging.experiments.modifications import Study, Variant, compare_modifications
from merging.experiments.transforms import DurationResult, TransformResult, measure_durations, measure_transforms
from tbmslam.belief.grid import TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.text_table import describe_machine
from tools.paper.maps import pair_of_area

VARIANTS = (Variant(128, "as it is"), Variant(256, "as it is"), Variant(128, "inverted"), Variant(256, "inverted"))


@dataclass(frozen=True)
class PaperSettings:
    """What the experiments depend on.

    Parameters
    ----------
    keypoints, ratios
        Rows of table II; the middle ones also serve the other tables.
    default_keypoints, default_ratio
        What the paper's program takes by default.
    tolerance_m
        Largest distance of a right match from its true position [m].
    areas_m2
        Areas of table IV for which pairs are cut from a building [m^2].
    repeats
        Timed runs of each pair.
    """

    keypoints: tuple[int, ...] = (100, 500, 1000, 2500, 5000)
    ratios: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8)
    default_keypoints: int = 1000
    default_ratio: float = 0.7
    tolerance_m: float = 0.5
    areas_m2: tuple[float, ...] = (4125.0, 4900.0, 5625.0, 8700.0, 12100.0, 13200.0)
    repeats: int = 10

    @property
    def features(self) -> FeatureConfig:
        """The paper's program's keypoints."""
        return FeatureConfig(keypoints=self.default_keypoints, ratio=self.default_ratio)


@dataclass(frozen=True)
class PaperResults:
    """What came out.

    Parameters
    ----------
    detectors
        Table I: by pair and detector.
    studies
        Table II and figure 3: by variant.
    transforms
        Table III: by pair.
    durations
        Table IV: of the pairs, then of those cut to the paper's areas.
    halves
        Figure 2.
    merged
        Figure 4: the first pair merged by the paper's algorithm 1; None if that found no transform.
    """

    detectors: Mapping[str, Mapping[str, DetectorResult]]
    studies: Mapping[Variant, Study]
    transforms: Mapping[str, TransformResult]
    durations: Mapping[str, DurationResult]
    halves: Halves
    merged: TbmGrid | None


def run_experiments(
    pairs: Sequence[MapPair], settings: PaperSettings, say: Callable[[str], None] = lambda _: None
) -> PaperResults:
    """Run all experiments; `say` receives the name of the next one."""
    say("table I: detectors")
    detectors = {
        pair.name: compare_detectors(pair, settings.default_keypoints, settings.default_ratio, settings.tolerance_m)
        for pair in pairs
    }
    studies = compare_modifications(
        pairs,
        settings.keypoints,
        settings.ratios,
        VARIANTS,
        settings.tolerance_m,
        lambda part: say(f"table II: {part}"),
    )
    say("table III: transforms")
    config = MergeConfig(features=settings.features)
    transforms = {pair.name: measure_transforms(pair, config, settings.tolerance_m) for pair in pairs}
    say("table IV: times")
    timed = {pair.name: pair for pair in pairs}
    resolution = pairs[0].target.geometry.resolution
    timed |= {f"cut for {area:g} m²": pair_of_area(area, resolution) for area in settings.areas_m2}
    durations = {name: measure_durations(pair, settings.repeats, settings.features) for name, pair in timed.items()}
    first = {pairs[0].target_name: TbmMap(pairs[0].target), pairs[0].source_name: TbmMap(pairs[0].source)}
    found = merge(first, PAPER).merged
    merged = None if found is None else found.grid
    return PaperResults(detectors, studies, transforms, durations, fuse_halves(pairs[0].target), merged)


def record_of(results: PaperResults, settings: PaperSettings, command: str) -> dict[str, object]:
    """Return every number that was measured, by table; null where there is none."""
    studies = [
        {
            **variant._asdict(),
            "rows": [
                {
                    **setting._asdict(),
                    "shares": [_number(share) for share in shares.tolist()],
                    "matches": study.matches[setting].tolist(),
                }
                for setting, shares in study.shares.items()
            ],
            "found": {str(asked): counts.tolist() for asked, counts in study.found.items()},
        }
        for variant, study in results.studies.items()
    ]
    return {
        "command": command,
        "settings": asdict(settings),
        "machine": describe_machine(),
        "table_1": {
            pair: {name: _numbers(list(asdict(result).items())) for name, result in by.items()}
            for pair, by in results.detectors.items()
        },
        "table_2": studies,
        "table_3": {pair: asdict(result) for pair, result in results.transforms.items()},
        "table_4": {
            pair: {"area_m2": result.area_m2, "milliseconds": result.milliseconds.tolist()}
            for pair, result in results.durations.items()
        },
    }


def _numbers(items: Sequence[tuple[str, float]]) -> dict[str, float | None]:
    return {key: _number(value) for key, value in items}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
