"""H_k: one small linear system per window of consecutive samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.errors import ShapeError

#: A column with less than half of the largest component is no part of the weakest direction.
_PART = 0.5
#: Smallest over largest singular value from which on elimination loses less than half of the digits.
_WELL_CONDITIONED = 1e-8
#: Of so many square windows one is looked at first: where none is well conditioned, few others are.
_ONE_OF = 50


class WindowSolution(NamedTuple):
    """Solutions of all windows.

    ``coefficients`` (n_windows, n_targets, n_regressors); ``singular_values``
    (n_windows, n_regressors) of the column-scaled H_k, largest first;
    ``condition_number`` and ``rank`` (n_windows,); ``residual_rms`` (n_windows,
    n_targets); ``column_rms`` (n_windows, n_regressors) of the unscaled H_k.
    """

    coefficients: FloatArray
    singular_values: FloatArray
    condition_number: FloatArray
    rank: IntArray
    residual_rms: FloatArray
    column_rms: FloatArray


def stack_windows(series: FloatArray, *, width: int, stride: int, step: int = 1) -> FloatArray:
    """View a series as overlapping windows, without copying.

    Parameters
    ----------
    series : ndarray, shape (n_samples, n_columns)
    width : int
        Samples per window.
    stride : int
        Samples from the start of one window to the start of the next.
    step : int
        Samples from one sample of a window to the next (the resampling period).

    Returns
    -------
    ndarray, shape (n_windows, width, n_columns)
        Row k of the result is the paper's H_k when ``series`` holds its
        regressors, eq. (5) and (11).

    Raises
    ------
    ShapeError
        If width, stride or step is below 1.

    Examples
    --------
    >>> stack_windows(np.arange(5.0)[:, np.newaxis], width=3, stride=1)[:, :, 0]
    array([[0., 1., 2.],
           [1., 2., 3.],
           [2., 3., 4.]])
    """
    if min(width, stride, step) < 1:
        raise ShapeError(f"width ({width}), stride ({stride}) and step ({step}) must all be at least 1.")
    span = (width - 1) * step + 1
    if series.shape[0] < span:
        return np.empty((0, width, series.shape[1]))
    view = np.lib.stride_tricks.sliding_window_view(series, span, axis=0)[::stride, :, ::step]
    return np.swapaxes(view, 1, 2)


def solve_windows(regressors: FloatArray, targets: FloatArray) -> WindowSolution:
    r"""Solve :math:`H_k \theta_n = \dot x_n` for every window at once, eq. (4) and (10).

    Square windows are inverted as the paper does, wider ones solved by least
    squares, rank-deficient ones by minimum norm: all from singular values of the
    column-scaled H_k, whose condition number does not depend on the units.

    Parameters
    ----------
    regressors : ndarray, shape (n_windows, n_samples, n_regressors)
        The coefficient matrices H_k, for example [qr pr pq | L M N].
    targets : ndarray, shape (n_windows, n_samples, n_targets)
        For example [p_dot q_dot r_dot] [rad/s^2].

    Returns
    -------
    WindowSolution
        ``coefficients[k, n]`` is row n of [A B] in window k. A badly conditioned window is no
        error: its singular values say how far to trust it.

    Raises
    ------
    ShapeError
        If a window has fewer samples than regressors.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> H = rng.standard_normal((2, 6, 6))
    >>> theta = np.arange(6.0)
    >>> solution = solve_windows(H, (H @ theta)[..., np.newaxis])
    >>> bool(np.allclose(solution.coefficients[:, 0], theta))
    True
    """
    _, n_samples, n_regressors = regressors.shape
    if n_samples < n_regressors:
        raise ShapeError(
            f"A window of {n_samples} samples cannot determine {n_regressors} unknowns.",
            hint=f"Use a window of at least {n_regressors} samples.",
        )
    length = np.sqrt(np.einsum("kij,kij->kj", regressors, regressors))[:, np.newaxis, :]
    scale = np.where(length > 0.0, length, 1.0)
    solve = _solve_square if n_samples == n_regressors else _solve_by_svd
    scaled_theta, singular, strong = solve(regressors / scale, targets)
    theta = scaled_theta / np.swapaxes(scale, 1, 2)
    residual = targets - regressors @ theta
    # Largest over smallest singular value, infinite where the smallest is rounding noise.
    found = np.full(len(singular), np.inf)
    np.divide(singular[:, 0], singular[:, -1], out=found, where=strong[:, -1])
    return WindowSolution(
        coefficients=np.swapaxes(theta, 1, 2),
        singular_values=singular,
        condition_number=found,
        rank=np.count_nonzero(strong, axis=1).astype(np.int64),
        residual_rms=np.sqrt(np.mean(residual**2, axis=1)),
        column_rms=length[:, 0, :] / np.sqrt(n_samples),
    )


def _solve_by_svd(H: FloatArray, Y: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the least-squares solutions, of minimum norm, with singular values and which of them count."""
    u, singular, vt = np.linalg.svd(H, full_matrices=False)
    # Below this a direction carries rounding noise only: give it zero weight.
    strong = singular > singular[:, :1] * H.shape[1] * np.finfo(np.float64).eps
    inverse = np.divide(1.0, singular, out=np.zeros_like(singular), where=strong)
    projected = inverse[..., np.newaxis] * (np.swapaxes(u, 1, 2) @ Y)
    return np.swapaxes(vt, 1, 2) @ projected, singular, strong


def _solve_square(H: FloatArray, Y: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the same for square H, where well conditioned by elimination: it takes half the time."""
    sample = np.asarray(np.linalg.svd(H[::_ONE_OF], compute_uv=False), dtype=np.float64)
    if not np.any(_well_conditioned(sample)):
        return _solve_by_svd(H, Y)
    singular = np.asarray(np.linalg.svd(H, compute_uv=False), dtype=np.float64)
    good = _well_conditioned(singular)
    theta, strong = np.empty_like(Y), np.ones(singular.shape, dtype=np.bool_)
    theta[good] = np.linalg.solve(H[good], Y[good])
    theta[~good], _, strong[~good] = _solve_by_svd(H[~good], Y[~good])
    return theta, singular, strong


def _well_conditioned(singular: FloatArray) -> BoolArray:
    """Say of each window whether elimination is good enough."""
    return np.asarray(singular[:, -1] > _WELL_CONDITIONED * singular[:, 0])


def weakest_words(direction: FloatArray, names: Sequence[str]) -> str:
    """Say which columns of H_k are nearly collinear, or which is poorly excited.

    Parameters
    ----------
    direction : ndarray, shape (n_regressors,)
        Right singular vector of the smallest singular value.
    names : sequence of str
        Of the columns; "1" is the constant.

    Returns
    -------
    str

    Examples
    --------
    >>> weakest_words(np.array([0.02, 0.7, -0.71]), ["p", "q", "M"])
    'q and M are nearly collinear'
    >>> weakest_words(np.array([0.0, 1.0, 0.1]), ["p", "q", "M"])
    'q is poorly excited'
    """
    size = np.abs(direction)
    said = ["the trim" if name == "1" else name for name in names]
    part = [name for name, one in zip(said, size, strict=True) if one >= _PART * size.max()]
    if len(part) == 1:
        return f"{part[0]} is poorly excited"
    return f"{', '.join(part[:-1])} and {part[-1]} are nearly collinear"
