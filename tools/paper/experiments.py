"""The experiments of the paper, on maps made by the programs of this project or from a recording."""

import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from merging import merge
from merging.config import PAPER, MergeConfig
from merging.config.registration import FeatureConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.io.map_folder import load_map
from tbmslam.map.tbm_map import TbmMap
from tools import build_maps, make_world
from tools.command_line.measurement_record import describe_machine
from tools.map_pairs.pair_of_area import pair_of_area
from tools.mapping.task import valid_json
from tools.mapping.truth_file import NAME as TRUTH_FILE
from tools.mapping.truth_file import read_truth_file
from tools.paper.detectors import DetectorResult, Study, Variant, compare_detectors, compare_modifications
from tools.paper.map_pair import Halves, MapPair, fuse_halves
from tools.paper.transforms import DurationResult, TransformResult, measure_durations, measure_transforms

logger = logging.getLogger(__name__)


def simulate_recordings(folder: Path, words: Sequence[str], drives: int, seed: int) -> list[Path]:
    """Simulate several drives of a robot through a building with options of make_world, and return the bags.

    Each drive has its own folder. `seed` is the seed of the building. The drives have the seeds `seed`, `seed + 1`, ...
    """
    bags = []
    for drive in range(drives):
        out = folder / f"drive_{drive}"
        code = make_world.main(["--seed", str(seed), "--drive-seed", str(seed + drive), "--out", str(out), *words])
        if code:
            raise TbmSlamError("the building could not be simulated: see the message above")
        bags.append(out / "robot_0.bag")
    return bags


def map_recordings(recordings: Sequence[Path], folder: Path, words: Sequence[str]) -> Path:
    """Map recordings by build_maps with more of its options, and return the folder with the maps and their truth."""
    code = build_maps.main([*map(str, recordings), "-o", str(folder), *words])
    if code:
        raise TbmSlamError("the recordings could not be mapped: see the message above")
    return folder


def map_simulated(bags: Sequence[Path], folder: Path, words: Sequence[str]) -> Path:
    """Map simulated drives separately, with the truth beside the bags as reference."""
    truths = [str(bag.with_suffix(".truth.tum")) for bag in bags]
    return map_recordings(bags, folder, ["--separate", "--reference", *truths, *words])


def load_pairs(folder: Path, most: int, min_overlap: float = 0.25) -> list[MapPair]:
    """Return the pairs of the maps that build_maps wrote into a folder, with their true poses."""
    truth = read_truth_file(folder / TRUTH_FILE)
    if (doubt := truth.doubt()) is not None:
        logger.warning("%s %s", folder / TRUTH_FILE, doubt)
    poses = truth.poses
    grids: dict[str, TbmGrid] = {name: load_map(folder / name).grid for name in poses}
    pairs: list[MapPair] = []
    for target, source in itertools.combinations(poses, 2):
        pair = MapPair(target, source, grids[target], grids[source], poses[target].inverse() @ poses[source])
        if len(pairs) < most and pair.overlap() >= min_overlap:
            pairs.append(pair)
    if not pairs:
        raise TbmSlamError(f"{folder}: no two of {len(poses)} maps share {min_overlap:.0%} of the smaller one")
    return pairs


def _pair_of_area(area_m2: float, resolution: float) -> MapPair:
    cut = pair_of_area(area_m2, resolution)
    assert cut.T_target_source is not None  # noqa: S101 - cut pairs overlap
    return MapPair("a", "b", cut.target.grid, cut.source.grid, cut.T_target_source)


VARIANTS = (Variant(128, "as it is"), Variant(256, "as it is"), Variant(128, "inverted"), Variant(256, "inverted"))


@dataclass(frozen=True)
class PaperSettings:
    """The settings of the experiments."""

    keypoints: tuple[int, ...]
    ratios: tuple[float, ...]
    """Rows of table II."""
    default_keypoints: int
    default_ratio: float
    """The row of table II whose settings serve the other tables."""
    tolerance_m: float
    """Largest distance of a right match from its true position [m]."""
    areas_m2: tuple[float, ...]
    """Areas of table IV for which pairs are cut from a building [m^2]."""
    repeats: int

    @property
    def features(self) -> FeatureConfig:
        """The paper's program's keypoints."""
        return FeatureConfig(keypoints=self.default_keypoints, ratio=self.default_ratio)


@dataclass(frozen=True)
class PaperResults:
    """The results."""

    detectors: Mapping[str, Mapping[str, DetectorResult]]
    """Table I: by pair and detector."""
    studies: Mapping[Variant, Study]
    """Table II and figure 3: by variant."""
    transforms: Mapping[str, TransformResult]
    """Table III: by pair."""
    durations: Mapping[str, DurationResult]
    """Table IV: of the pairs, then of those cut to the paper's areas."""
    halves: Halves
    """Figure 2."""
    merged: TbmGrid | None
    """Figure 4: the first pair merged by the paper's algorithm 1; None without a transform."""


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
    timed |= {f"cut for {area:g} m²": _pair_of_area(area, resolution) for area in settings.areas_m2}
    durations = {name: measure_durations(pair, settings.repeats, settings.features) for name, pair in timed.items()}
    first = {pairs[0].target_name: TbmMap(pairs[0].target), pairs[0].source_name: TbmMap(pairs[0].source)}
    found = merge(first, PAPER).merged
    merged = None if found is None else found.grid
    return PaperResults(detectors, studies, transforms, durations, fuse_halves(pairs[0].target), merged)


def record_of(results: PaperResults, settings: PaperSettings, command: str) -> dict[str, object]:
    """Return all measured numbers by table for JSON; None where there is none."""
    studies = [
        {
            **variant._asdict(),
            "rows": [
                {
                    **setting._asdict(),
                    "shares": shares.tolist(),
                    "matches": study.matches[setting].tolist(),
                }
                for setting, shares in study.shares.items()
            ],
            "found": {str(asked): counts.tolist() for asked, counts in study.found.items()},
        }
        for variant, study in results.studies.items()
    ]
    return valid_json(
        {
            "command": command,
            "settings": asdict(settings),
            "machine": describe_machine(),
            "table_1": {
                pair: {name: asdict(result) for name, result in by.items()} for pair, by in results.detectors.items()
            },
            "table_2": studies,
            "table_3": {pair: asdict(result) for pair, result in results.transforms.items()},
            "table_4": {
                pair: {"area_m2": result.area_m2, "milliseconds": result.milliseconds.tolist()}
                for pair, result in results.durations.items()
            },
        }
    )
