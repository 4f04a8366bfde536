"""How well numbers are known that parts of a drive tell each by itself."""

import numpy as np

from tbmslam.geometry.se2 import FloatArray


def deviations_of_parts(values: FloatArray, informations: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of numbers: the larger ones of what parts state and of how far they differ.

    With informations A_p and their sum A, the second ones are the roots of the diagonal of

        P / (P - 1)  A^-1  sum_p A_p (v_p - m) (v_p - m)^T A_p  A^-1

    which holds whatever the parts take themselves to know (K.-Y. Liang, S. Zeger, "Longitudinal data analysis using
    generalized linear models", Biometrika 1986, its V_G for P clusters).

    Parameters
    ----------
    values
        What each of P parts, two at least, tells (P, n).
    informations
        How well each takes itself to know it (P, n, n).
    mean
        What all of them tell together (n,).
    """
    parts = len(values)
    stated = np.linalg.inv(informations.sum(axis=0))
    pulls = np.einsum("pij,pj->pi", informations, values - mean)
    differing = stated @ (pulls.T @ pulls) @ stated * parts / (parts - 1)
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(stated), np.diag(differing)))
    return deviations
