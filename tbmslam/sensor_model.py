"""Inverse sensor model: what one beam says about the cells it ends in, passes, and nearly reaches.

Source: vinySLAM (Huletski, Kartashov, Krinkin, "VinySLAM: an indoor SLAM method for low-cost platforms based on the
Transferable Belief Model", IROS 2017) with the constants of its program.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tbmslam.kernels.insertion import BeamFactors
from tbmslam.se2 import FloatArray


class SensorModelConfig(BaseModel):
    """How much a beam is believed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    hit_probability: float = Field(0.95, gt=0, lt=1, description="probability of occupied in the cell a beam ends in")
    hit_quality: float = Field(0.04, gt=0, lt=1, description="mass that one hit commits; the rest stays unknown")
    miss_probability: float = Field(0.01, gt=0, lt=1, description="probability of occupied in a cell a beam passes")
    miss_quality: float = Field(0.003, gt=0, lt=1, description="mass that one passage commits")
    wall_blur: float = Field(0.3, ge=0, description="length before a hit over which passage turns into wall [m]")


def beam_factors(config: SensorModelConfig, resolution: float, scan_quality: float) -> BeamFactors:
    """Turn the model into factors for cells of a size and scans of a quality.

    An observation with probability p and quality w has masses m(OCCUPIED) = p w, m(FREE) = (1 - p) w and
    m(UNKNOWN) = 1 - w; the factors are its commonalities divided by m(UNKNOWN).
    """
    radius_squared = (config.wall_blur / resolution) ** 2
    distances_squared = np.arange(int(np.ceil(radius_squared)), dtype=np.float64)
    blurred = config.hit_probability * (1.0 - distances_squared / radius_squared) if radius_squared > 0 else np.zeros(0)
    return BeamFactors(
        hit=_factors(np.array(config.hit_probability), config.hit_quality * scan_quality),
        miss=_factors(np.array(config.miss_probability), config.miss_quality * scan_quality),
        blur=_factors(blurred, config.miss_quality * scan_quality),
        blur_radius_squared=radius_squared,
    )


def _factors(probability: FloatArray, weight: float) -> FloatArray:
    unknown = 1.0 - weight
    occupied = probability * weight
    free = (1.0 - probability) * weight
    return np.stack(((free + unknown) / unknown, (occupied + unknown) / unknown), axis=-1)
