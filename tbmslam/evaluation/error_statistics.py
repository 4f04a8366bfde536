"""Errors summed up as the field reports them."""

from dataclasses import dataclass

import numpy as np

from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class ErrorStatistics:
    """Figures about absolute errors, in the errors' own unit.

    Parameters
    ----------
    rmse
        Root mean square.
    mean, standard_deviation, median, maximum
        What they say; the deviation is that of the whole set, not an estimate from a sample.
    """

    rmse: float
    mean: float
    standard_deviation: float
    median: float
    maximum: float

    @classmethod
    def of(cls, errors: FloatArray) -> "ErrorStatistics":
        """Sum up errors (N,), N > 0."""
        if not len(errors):
            raise ValueError("errors must hold at least one value, got none")
        return cls(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(np.mean(errors)),
            standard_deviation=float(np.std(errors)),
            median=float(np.median(errors)),
            maximum=float(np.max(errors)),
        )
