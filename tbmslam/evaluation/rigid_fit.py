"""The rigid motion that lays points onto points."""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2


def fit_rigid(target: npt.ArrayLike, source: npt.ArrayLike) -> tuple[SE2, float]:
    """Return the rigid motion T_target_source with the least squared distance, and the best fitting scale.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991, in the plane and
    with the scale reported, not applied. The scale of coincident points is nan.

    Parameters
    ----------
    target, source
        Points (N, 2) that belong together [m].
    """
    target, source = np.asarray(target, dtype=np.float64), np.asarray(source, dtype=np.float64)
    target_mean, source_mean = target.mean(axis=0), source.mean(axis=0)
    p, q = target - target_mean, source - source_mean
    dot, cross = float((p * q).sum()), float((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum())
    rotation = SE2(0.0, 0.0, float(np.arctan2(cross, dot)))
    spread = float((q**2).sum())
    x, y = target_mean - rotation.apply(source_mean)
    return SE2(float(x), float(y), rotation.theta), float(np.hypot(dot, cross) / spread) if spread > 0.0 else np.nan
