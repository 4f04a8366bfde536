"""Standard deviations of parameters that are estimated from parts of a drive."""

import numpy as np

from tbmslam.geometry.se2 import FloatArray


def deviations_of_parts(values: FloatArray, informations: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of joint estimates: the larger of the formal and the empirical ones.

    The formal ones follow from the informations A_p of the parts and their sum A. The empirical ones are the roots of
    the diagonal of

        P / (P - 1)  A^-1  sum_p A_p (v_p - m) (v_p - m)^T A_p  A^-1

    which is valid even if the informations are wrong (K.-Y. Liang, S. Zeger, "Longitudinal data analysis using
    generalized linear models", Biometrika 1986, its V_G for P clusters).

    Parameters
    ----------
    values
        Estimates of P >= 2 parts (P, n).
    informations
        Information of each estimate (P, n, n).
    mean
        Joint estimate m (n,).
    """
    parts = len(values)
    formal = np.linalg.inv(informations.sum(axis=0))
    residuals = np.einsum("pij,pj->pi", informations, values - mean)
    empirical = formal @ (residuals.T @ residuals) @ formal * parts / (parts - 1)
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(formal), np.diag(empirical)))
    return deviations
