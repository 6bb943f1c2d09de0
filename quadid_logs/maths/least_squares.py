"""Linear least squares by SVD on scaled columns, with intervals for coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.errors import ShapeError


class LeastSquares(NamedTuple):
    """The solution of one least-squares problem.

    ``coefficients`` (n_targets, n_regressors); ``residuals`` (n_samples,
    n_targets); ``condition_number`` and ``rank`` of the column-scaled matrix.
    """

    coefficients: FloatArray
    residuals: FloatArray
    condition_number: float
    rank: int


def solve_least_squares(regressors: FloatArray, targets: FloatArray) -> LeastSquares:
    r"""Minimise :math:`\lVert Z \Theta^T - Y \rVert_F` with unit-length columns of Z.

    Parameters
    ----------
    regressors : ndarray, shape (n_samples, n_regressors)
    targets : ndarray, shape (n_samples, n_targets)

    Returns
    -------
    LeastSquares

    Raises
    ------
    ShapeError
        If there are fewer samples than regressors, or the lengths differ.

    Notes
    -----
    The normal equations are avoided because they square the condition number
    (Golub and Van Loan, Matrix Computations, 4th ed., sec. 5.3); columns are
    scaled because otherwise the condition number measures the choice of units
    (van der Sluis 1969, doi:10.1007/BF02165096).

    Examples
    --------
    >>> Z = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    >>> solve_least_squares(Z, Z @ np.array([[2.0], [3.0]])).coefficients.round(9)
    array([[2., 3.]])
    """
    n_samples, n_regressors = regressors.shape
    if targets.shape[0] != n_samples or n_samples < n_regressors:
        raise ShapeError(
            f"{n_samples} samples of {n_regressors} regressors do not determine "
            f"targets of shape {targets.shape}."
        )
    scale = column_scale(regressors)
    # QR first: the SVD of the small triangle has the same singular values and costs nothing.
    q, triangle = np.linalg.qr(regressors / scale)
    u, singular, vt = np.linalg.svd(triangle)
    floor = singular[0] * n_samples * np.finfo(np.float64).eps
    inverse = np.divide(1.0, singular, out=np.zeros_like(singular), where=singular > floor)
    coefficients = ((vt.T * inverse) @ (u.T @ (q.T @ targets))).T / scale
    rank = int(np.count_nonzero(singular > floor))
    condition = float(singular[0] / singular[-1]) if rank == n_regressors else float("inf")
    return LeastSquares(coefficients, targets - regressors @ coefficients.T, condition, rank)


def column_scale(regressors: FloatArray) -> FloatArray:
    """Return the length of each column, 1 where a column is zero; shape (n_regressors,)."""
    length = np.linalg.norm(regressors, axis=0)
    return np.where(length > 0.0, length, 1.0)


class Equation(NamedTuple):
    """The rows of one target in a problem whose targets may share parameters.

    ``jacobian`` (n_samples, n_own) holds the derivatives by the parameters
    numbered in ``parameters`` (n_own,); ``residuals`` (n_samples,).
    """

    jacobian: FloatArray
    residuals: FloatArray
    parameters: IntArray


def clustered_covariance(
    equations: Sequence[Equation],
    clusters: IntArray,
    n_parameters: int,
    prior_precision: FloatArray | None = None,
) -> FloatArray:
    r"""Covariance of least-squares parameters when residuals are correlated in time.

    The sandwich :math:`(J^T J)^{-1} \left[\sum_c s_c s_c^T\right] (J^T J)^{-1}`
    with the score :math:`s_c = \sum_{i \in c} J_i e_i` summed over stretches
    longer than the memory of the residuals, so that any autocorrelation (and
    any difference in variance, and any correlation between targets) inside a
    stretch is counted in full. White-noise formulas were 5 to 7 times too
    small on flight data.

    Parameters
    ----------
    equations : sequence of Equation
        One per target, on the same samples.
    clusters : ndarray of int, shape (n_samples,)
        Number of the stretch that each sample lies in, from 0.
    n_parameters : int
    prior_precision : ndarray, shape (n_parameters,), optional
        One over the variance of what was known of each parameter before, in
        units in which the residuals have unit variance; 0 where nothing was.

    Returns
    -------
    ndarray, shape (n_parameters, n_parameters)

    References
    ----------
    K.-Y. Liang and S. L. Zeger, "Longitudinal data analysis using generalized
    linear models," Biometrika, vol. 73, pp. 13-22, 1986; small-sample factor
    of A. C. Cameron and D. L. Miller, J. Human Resources, vol. 50, 2015, eq. (12).
    """
    squares = np.zeros(n_parameters)
    for equation in equations:
        squares[equation.parameters] += np.einsum("ij,ij->j", equation.jacobian, equation.jacobian)
    scale = np.where(squares > 0.0, np.sqrt(squares), 1.0)
    n_clusters = int(clusters.max()) + 1
    scores = np.zeros((n_clusters, n_parameters))
    triangles = []
    for jacobian, residuals, parameters in equations:
        scaled = jacobian / scale[parameters]
        triangle = np.zeros((min(scaled.shape), n_parameters))
        triangle[:, parameters] = np.linalg.qr(scaled, mode="r")
        triangles.append(triangle)
        for column, parameter in enumerate(parameters):
            scores[:, parameter] += np.bincount(clusters, scaled[:, column] * residuals, n_clusters)
    prior = np.zeros(n_parameters) if prior_precision is None else prior_precision / scale**2
    triangles.append(np.diag(np.sqrt(prior)))
    _, singular, vt = np.linalg.svd(np.concatenate(triangles), full_matrices=False)
    n_samples = sum(len(equation.residuals) for equation in equations)
    floor = singular[0] * n_samples * np.finfo(np.float64).eps
    inverse = np.divide(1.0, singular**2, out=np.zeros_like(singular), where=singular > floor)
    bread = (vt.T * inverse) @ vt
    n_filled = np.unique(clusters).size
    small_sample = n_filled / max(n_filled - 1, 1) * (n_samples - 1) / max(n_samples - n_parameters, 1)
    # What was known before is one more observation of its parameter, as uncertain as it says.
    covariance = bread @ (small_sample * scores.T @ scores + np.diag(prior)) @ bread
    return np.asarray(covariance / np.outer(scale, scale), dtype=np.float64)
