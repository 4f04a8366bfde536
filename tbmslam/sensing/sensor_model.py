"""Inverse sensor model: the evidence of one beam for the cells it ends in, passes, and nearly reaches.

Source: vinySLAM (Huletski, Kartashov, Krinkin, "VinySLAM: an indoor SLAM method for low-cost platforms based on the
Transferable Belief Model", IROS 2017) with the constants of its program. The averaging rule is that of tinySLAM by the
same authors (after Steux and El Hamzaoui, "tinySLAM: a SLAM algorithm in less than 200 lines", 2010).
"""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.rays.insertion import BeamFactors


class SensorModelConfig(FrozenConfig):
    """The evidence of a beam; qualities apply where evidence is combined conjunctively."""

    PUBLIC: ClassVar = ("hit_quality", "miss_quality")

    hit_probability: float = Field(0.95, gt=0, le=1, description="probability of occupied in the cell a beam ends in")
    hit_quality: float = Field(0.04, gt=0, lt=1, description="mass of one hit; the rest is unknown")
    miss_probability: float = Field(0.01, ge=0, lt=1, description="probability of occupied in a cell a beam passes")
    miss_quality: float = Field(0.003, gt=0, lt=1, description="mass of one passage")
    wall_blur: float = Field(0.3, ge=0, description="length before a hit over which free turns into occupied [m]")
    combination: Literal["conjunctive", "mean"] = Field(
        "conjunctive", description="'mean' takes the mean of all probabilities of a cell; no mass stays unknown"
    )


_MEAN_WEIGHT = 1e9
"""Evidence K of one observation by the averaging rule: large, so that nothing stays unknown, but masses keep their
digits."""


def beam_factors(config: SensorModelConfig, resolution: float, scan_quality: float) -> BeamFactors:
    """Return the factors of the model for cells of a size and scans of a quality.

    By the conjunctive rule, an observation with probability p and quality w has masses m(OCCUPIED) = p w,
    m(FREE) = (1 - p) w and m(UNKNOWN) = 1 - w; the factors are its commonalities divided by m(UNKNOWN).

    By the averaging rule, an observation adds K p to a_O and K (1 - p) to a_F with a large K. After n observations
    m(UNKNOWN) is 1 / (K n), and m(OCCUPIED) is otherwise the mean of p. Low quality of a scan moves p towards 0.5.
    """
    factors = _factors if config.combination == "conjunctive" else _addends
    radius_squared = (config.wall_blur / resolution) ** 2
    distances_squared = np.arange(int(np.ceil(radius_squared)), dtype=np.float64)
    blurred = config.hit_probability * (1.0 - distances_squared / radius_squared) if radius_squared > 0 else np.zeros(0)
    hit_weight, miss_weight = (
        (scan_quality, scan_quality)
        if config.combination == "mean"
        else (config.hit_quality * scan_quality, config.miss_quality * scan_quality)
    )
    return BeamFactors(
        hit=factors(np.array(config.hit_probability), hit_weight),
        miss=factors(np.array(config.miss_probability), miss_weight),
        blur=factors(blurred, miss_weight),
        blur_radius_squared=radius_squared,
        adds=config.combination == "mean",
    )


def _factors(probability: FloatArray, weight: float) -> FloatArray:
    unknown = 1.0 - weight
    occupied = probability * weight
    free = (1.0 - probability) * weight
    return np.stack(((free + unknown) / unknown, (occupied + unknown) / unknown), axis=-1)


def _addends(probability: FloatArray, weight: float) -> FloatArray:
    drawn = 0.5 + (probability - 0.5) * weight
    return _MEAN_WEIGHT * np.stack((1.0 - drawn, drawn), axis=-1)
