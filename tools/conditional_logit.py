"""Weights under which the right candidate of each pair, or none of them, is the likeliest: a conditional logit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize

from tbmslam.se2 import FloatArray

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Choice:
    """The candidates of one pair of maps.

    Parameters
    ----------
    name
        The pair.
    features
        Numbers (K, F) about each candidate.
    right
        Which candidates (K,) are the truth; none where no candidate is.
    weight
        How many usual pairs this one counts for.
    near
        Which candidates (K,) lie where the truth does, be they turned a little too far; None where those are the right
        ones. It is they that a fit learns from: what to tell apart are places, not how exactly they were met.
    """

    name: str
    features: FloatArray
    right: BoolArray
    weight: float = 1.0
    near: BoolArray | None = None


@dataclass(frozen=True)
class Logit:
    """A bias and weights (F,) of features."""

    bias: float
    weights: FloatArray

    def probabilities(self, features: FloatArray) -> FloatArray:
        """Return the probability of each candidate (K,)."""
        logits = np.append(features @ self.weights + self.bias, 0.0)
        shares = np.exp(logits - logits.max())
        return np.asarray(shares[:-1] / shares.sum())


def fit(choices: Sequence[Choice], signs: Sequence[int], penalty: float, *, none: bool = True) -> Logit:
    """Return the weights of greatest likelihood, less a penalty on their squares.

    Parameters
    ----------
    choices
        Pairs whose truth is known.
    signs
        1 for a feature that can only speak for a candidate, -1 for one that can only speak against, 0 for either.
    penalty
        On the squares of the weights of standardised features, by pair.
    none
        Whether "none of them" is an answer too; else every choice has a right candidate, and the bias is 0.
    """
    everything = np.vstack([choice.features for choice in choices])
    mean, spread = everything.mean(axis=0), everything.std(axis=0) + 1e-9
    most = max(len(choice.features) for choice in choices)
    x = np.zeros((len(choices), most, everything.shape[1]))
    there, right = np.zeros((len(choices), most), np.bool_), np.zeros((len(choices), most), np.bool_)
    for index, choice in enumerate(choices):
        count = len(choice.features)
        x[index, :count] = (choice.features - mean) / spread
        there[index, :count], right[index, :count] = True, choice.right if choice.near is None else choice.near
    target = np.column_stack((right, ~right.any(axis=1)))
    weights = np.array([choice.weight for choice in choices])
    strength = penalty * float(weights.sum())

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        logits = np.where(there, x @ parameters[1:] + parameters[0], -1e9)
        logits = np.column_stack((logits, np.full(len(x), 0.0 if none else -1e9)))
        shares = np.exp(logits - logits.max(axis=1, keepdims=True))
        shares /= shares.sum(axis=1, keepdims=True)
        hit = shares * target
        likely = hit.sum(axis=1, keepdims=True)
        slope = weights[:, None] * ((shares - hit / likely)[:, :most]) * there
        gradient = np.concatenate(([slope.sum()], np.einsum("nk,nkf->f", slope, x)))
        gradient[1:] += 2.0 * strength * parameters[1:]
        return float(-weights @ np.log(likely[:, 0]) + strength * (parameters[1:] ** 2).sum()), gradient

    bounds = [(None, None)] + [(0.0 if sign > 0 else None, 0.0 if sign < 0 else None) for sign in signs]
    found = optimize.minimize(loss, np.zeros(len(signs) + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    return Logit(float(found[0] - (found[1:] * mean / spread).sum()) if none else 0.0, found[1:] / spread)
