"""Linear least squares by SVD on scaled columns, with intervals for coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.errors import ShapeError

#: Keeps a cluster that alone carries a parameter from dividing by zero: its interval is huge all the same.
_SINGULAR = 1e-9
#: Each has three matrices of all parameters: a long flight has thousands of clusters.
_CLUSTERS_AT_ONCE = 256


class LeastSquares(NamedTuple):
    """The solution of one least-squares problem.

    ``coefficients`` (n_targets, n_regressors); ``residuals`` (n_samples,
    n_targets); ``condition_number`` and ``rank`` of the column-scaled matrix.
    """

    coefficients: FloatArray
    residuals: FloatArray
    condition_number: float
    rank: int


def without_rounding(remainder: FloatArray, original: FloatArray) -> FloatArray:
    """Return what an operation has left of columns, zero where that is rounding.

    Scaled to unit length, as a basis of the columns is made, rounding would look like a signal.

    Parameters
    ----------
    remainder, original : ndarray, shape (n_samples, n_columns)
        Columns after the operation and before it.

    Returns
    -------
    ndarray, shape (n_samples, n_columns)

    Notes
    -----
    Each sample is rounded in a sum over the samples, of n terms: by about eps sqrt(n) times their root mean
    square, as rounding errors have either sign. So the norm of what is left is at least eps sqrt(n) times the
    norm of the original, or it tells nothing (N. Higham, Accuracy and Stability of Numerical Algorithms,
    2002, sec. 2.8).

    Examples
    --------
    >>> original = np.full((1000, 1), 0.1)
    >>> bool(without_rounding(original - original.mean(axis=0), original).any())
    False
    """
    rounding = np.finfo(np.float64).eps * np.sqrt(len(original))
    told = np.linalg.norm(remainder, axis=0) > rounding * np.linalg.norm(original, axis=0)
    return np.where(told, remainder, 0.0)


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
            f"{n_samples} samples cannot determine {n_regressors} coefficients for targets of shape "
            f"{targets.shape}."
        )
    scale = column_scale(regressors)
    # QR first: the SVD of the small triangle has the same singular values and costs nothing.
    q, triangle = np.linalg.qr(regressors / scale)
    u, singular, vt = np.linalg.svd(triangle)
    significant = singular > singular[0] * n_samples * np.finfo(np.float64).eps
    inverse = np.divide(1.0, singular, out=np.zeros_like(singular), where=significant)
    coefficients = ((vt.T * inverse) @ (u.T @ (q.T @ targets))).T / scale
    rank = int(np.count_nonzero(significant))
    condition = float(singular[0] / singular[-1]) if rank == n_regressors else float("inf")
    return LeastSquares(coefficients, targets - regressors @ coefficients.T, condition, rank)


def column_scale(regressors: FloatArray) -> FloatArray:
    """Return the Euclidean length of each column.

    Parameters
    ----------
    regressors : ndarray, shape (n_samples, n_regressors)

    Returns
    -------
    ndarray, shape (n_regressors,)
        1 where a column is zero.
    """
    length = np.linalg.norm(regressors, axis=0)
    return np.where(length > 0.0, length, 1.0)


class Equation(NamedTuple):
    """The rows of one target in a problem whose targets may have parameters in common.

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
    with the score :math:`s_c = J_c^T (I - H_c)^{-1} e_c` of clusters
    longer than the memory of the residuals, so that any autocorrelation (and
    any difference in variance, and any correlation between targets) inside a
    cluster is counted in full. White-noise formulas were 5 to 7 times too
    small on flight data. The leverage H_c of a cluster makes its residual
    that of a fit without it (CR3, the jackknife): where few manoeuvres carry
    an estimate, the residuals that they leave are too small to judge it by.

    Parameters
    ----------
    equations : sequence of Equation
        One per target, on the same samples.
    clusters : ndarray of int, shape (n_samples,)
        Number of the cluster that each sample lies in, from 0.
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
    linear models," Biometrika, vol. 73, pp. 13-22, 1986; CR3 of R. M. Bell and D. F.
    McCaffrey, Survey Methodology 28, 2002, and J. G. MacKinnon, M. O. Nielsen and
    M. D. Webb, J. Econometrics 232, 2023.
    """
    # The length of each parameter's column over all equations, 1 where it is zero.
    squares = np.zeros(n_parameters)
    for equation in equations:
        squares[equation.parameters] += np.einsum("ij,ij->j", equation.jacobian, equation.jacobian)
    scale = np.where(squares > 0.0, np.sqrt(squares), 1.0)
    prior = np.zeros(n_parameters) if prior_precision is None else prior_precision / scale**2
    # The pseudo-inverse of J^T J plus the prior's precision, J in scaled columns.
    rows = [*(_triangle(equation, scale) for equation in equations), np.diag(np.sqrt(prior))]
    _, singular, vt = np.linalg.svd(np.concatenate(rows), full_matrices=False)
    n_samples = sum(len(equation.residuals) for equation in equations)
    significant = singular > singular[0] * n_samples * np.finfo(np.float64).eps
    inverse = np.divide(1.0, singular**2, out=np.zeros_like(singular), where=significant)
    bread = np.asarray((vt.T * inverse) @ vt)
    scores, information = _by_cluster(equations, clusters, scale)
    identity, jackknifed = np.eye(len(bread)), np.empty_like(scores)
    for first in range(0, len(scores), _CLUSTERS_AT_ONCE):
        part = slice(first, first + _CLUSTERS_AT_ONCE)
        # Without a cluster, the fit would have left (I - H)^-1 of that cluster's residual.
        left_out = identity - information[part] @ bread + _SINGULAR * identity
        jackknifed[part] = np.linalg.solve(left_out, scores[part, :, np.newaxis])[..., 0]
    small_sample = (len(scores) - 1) / len(scores)
    # The prior is one more observation of its parameter, as uncertain as it says.
    covariance = bread @ (small_sample * jackknifed.T @ jackknifed + np.diag(prior)) @ bread
    return np.asarray(covariance / np.outer(scale, scale), dtype=np.float64)


def first_order_change(
    equations: Sequence[Equation],
    errors: Sequence[FloatArray],
    n_parameters: int,
    prior_precision: FloatArray | None = None,
    *,
    through: Sequence[FloatArray] | None = None,
) -> FloatArray:
    """Return the change of least-squares parameters by errors of their targets.

    Least squares is linear in its targets: (J^T J)^-1 J^T times the errors.

    Parameters
    ----------
    equations : sequence of Equation
    errors : sequence of ndarray, shape (n_samples, n_errors)
        One per equation, weighted as its residuals are.
    n_parameters : int
    prior_precision : ndarray, shape (n_parameters,), optional
        As of `clustered_covariance`.
    through : sequence of ndarray, shape (n_samples, n_own), optional
        What stands for the transposed J, one per equation: of instrumental variables the columns that
        errors are multiplied with are not those of the information.

    Returns
    -------
    ndarray, shape (n_parameters, n_errors)
    """
    columns = [equation.jacobian for equation in equations] if through is None else through
    information = np.diag(np.zeros(n_parameters) if prior_precision is None else prior_precision)
    score = np.zeros((n_parameters, errors[0].shape[1]))
    for (jacobian, _, parameters), error, by in zip(equations, errors, columns, strict=True):
        information[np.ix_(parameters, parameters)] += jacobian.T @ jacobian
        score[parameters] += by.T @ error
    diagonal = np.diag(information)
    scale = np.where(diagonal > 0.0, np.sqrt(diagonal), 1.0)
    scaled = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    return np.asarray((scaled @ (score / scale[:, np.newaxis])) / scale[:, np.newaxis])


def _triangle(equation: Equation, scale: FloatArray) -> FloatArray:
    """Return the triangle of an equation's scaled rows, with zeros for the parameters of others."""
    scaled = equation.jacobian / scale[equation.parameters]
    triangle = np.zeros((min(scaled.shape), scale.size))
    triangle[:, equation.parameters] = np.linalg.qr(scaled, mode="r")
    return triangle


def _by_cluster(
    equations: Sequence[Equation], clusters: IntArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return scores (n_filled, n_parameters) and information (n_filled, n_parameters, n_parameters)."""
    order = np.argsort(clusters, kind="stable")
    starts = np.flatnonzero(np.diff(clusters[order], prepend=-1))
    parts = np.split(order, starts[1:])
    scores = np.zeros((len(parts), scale.size))
    information = np.zeros((len(parts), scale.size, scale.size))
    for jacobian, residuals, parameters in equations:
        scaled = jacobian / scale[parameters]
        place = np.ix_(parameters, parameters)
        for number, rows in enumerate(parts):
            own = scaled[rows]
            scores[number, parameters] += own.T @ residuals[rows]
            information[number][place] += own.T @ own
    return scores, information
