"""The confidence of a pose at which a map was deformed.

A deformed map passes two tests, an alignment without an initial guess and a comparison with deformed rivals. Their
confidences are too high: most pairs that reach these tests show different places, and a deformed map fits more poses
than a rigid one. The share of the floor that agrees is further evidence. A deformation at the true pose removes the
distortion, so most blocks of the floor agree. At a false pose some tiles find walls by chance, and the blocks between
them do not agree.

`tools/calibrate_deformed.py` fits the weights. The shipped ones are older than the comparison of the deformed with the
rigid map (`merging.nonrigid.search`). A new fit to 109 attempts that pass it accepts the same 91 right ones, and no
wrong one.
"""

import json
import math
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources

import numpy as np

from merging.verification import Evidence
from tbmslam.geometry.se2 import FloatArray

_SURE = 0.9995
"""Largest confidence of a test that counts; the smallest is 1 minus this."""


@dataclass(frozen=True)
class DeformedTests:
    """The outcome of both tests of a deformed map."""

    aligned: float
    """Confidence of the alignment of the deformed map without an initial guess."""
    among_rivals: float
    """Confidence of the pose among deformed rivals."""
    agreeing_share: float
    """Share of the blocks of the floor that agree."""

    @classmethod
    def of(cls, aligned: float, among_rivals: float, evidence: Evidence) -> "DeformedTests":
        """Return the tests with the evidence for the pose of the deformed map."""
        # The one block more reduces the share of few blocks.
        share = evidence.pieces.agreeing / (evidence.pieces.compared + 1.0)
        return cls(aligned, among_rivals, share)

    @property
    def less_certain(self) -> float:
        """The confidence of the less certain test."""
        return min(self.aligned, self.among_rivals)

    @property
    def features(self) -> FloatArray:
        """The constant 1, the log odds of the less certain test, and the share (3,)."""
        p = min(max(self.less_certain, 1.0 - _SURE), _SURE)
        return np.array([1.0, math.log(p / (1.0 - p)), self.agreeing_share])

    @property
    def confidence(self) -> float:
        """The probability that the pose is right, by the shipped model."""
        return _shipped().confidence(self)


@dataclass(frozen=True)
class DeformedModel:
    """The weights of the features of `DeformedTests`, in their order."""

    bias: float
    less_certain_test: float
    agreeing_share: float

    @classmethod
    def from_json(cls, text: str) -> "DeformedModel":
        """Read the text of `as_json`."""
        found = json.loads(text)
        return cls(*(float(found[field.name]) for field in fields(cls)))

    def as_json(self) -> str:
        """Return the weights by name, to six digits."""
        named = zip(fields(self), self.weights.tolist(), strict=True)
        return json.dumps({field.name: round(weight, 6) for field, weight in named}, indent=2) + "\n"

    @property
    def weights(self) -> FloatArray:
        """The weights (3,)."""
        return np.array([self.bias, self.less_certain_test, self.agreeing_share])

    def confidence(self, tests: DeformedTests) -> float:
        """Return the probability that a pose is right."""
        return 1.0 / (1.0 + math.exp(-float(tests.features @ self.weights)))


@cache
def _shipped() -> DeformedModel:
    return DeformedModel.from_json(
        resources.files("merging").joinpath("deformed_model.json").read_text(encoding="utf-8")
    )
