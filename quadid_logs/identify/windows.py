"""The paper's windows: H_k at every k, with its condition number and rank."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.data.model import Windows
from quadid_logs.maths.windows import WindowSolution, solve_windows, stack_windows

#: Windows solved at once: 20 000 of 9x9 are 13 MB, so memory stays flat for any log.
_CHUNK = 20_000


class Piece(NamedTuple):
    """A gap-free stretch: columns (n_samples, n_regressors), targets (n_samples, n_targets), uniform time."""

    columns: FloatArray
    targets: FloatArray
    time_s: FloatArray


def solve_pieces(pieces: Iterable[Piece], *, width: int, stride: int, noise: FloatArray) -> Windows | None:
    """Solve H_k theta = x_dot for the windows of several gap-free stretches.

    Parameters
    ----------
    pieces : iterable of Piece
    width, stride : int
        Samples per window and between windows.
    noise : ndarray, shape (n_regressors,)
        Root mean square of the noise in each column.

    Returns
    -------
    Windows, or None if all stretches are shorter than one window.
    """
    solved = (_solve_piece(piece, width, stride, noise) for piece in pieces)
    return _join([part for part in solved if part is not None])


def _solve_piece(piece: Piece, width: int, stride: int, noise: FloatArray) -> Windows | None:
    """Solve the windows of one stretch; None if it is shorter than one."""
    columns, targets, time_s = piece
    H = stack_windows(columns, width=width, stride=stride)
    if H.shape[0] == 0:
        return None
    Y = stack_windows(targets, width=width, stride=stride)
    chunks = [
        solve_windows(H[first : first + _CHUNK], Y[first : first + _CHUNK])
        for first in range(0, H.shape[0], _CHUNK)
    ]
    solution = WindowSolution(*(np.concatenate(part) for part in zip(*chunks, strict=True)))
    floor = _noise_floor(solution.column_rms, noise)
    full_rank = solution.rank == columns.shape[1]
    return Windows(
        time_s=time_s[: H.shape[0] * stride : stride] + 0.5 * (width - 1) * (time_s[1] - time_s[0]),
        coefficients=solution.coefficients,
        condition_number=solution.condition_number,
        rank=solution.rank,
        residual_rms=solution.residual_rms,
        singular_values=solution.singular_values,
        noise_floor=floor,
        used=full_rank & (solution.singular_values[:, -1] > floor),
        weakest=_weakest(H),
        width=width,
        stride=stride,
        period_s=float(time_s[1] - time_s[0]),
    )


def _weakest(H: FloatArray) -> FloatArray:
    """Return the direction that the windows, columns of each scaled to unit length, see least."""
    n_columns = H.shape[2]
    squares = np.zeros((n_columns, n_columns))
    for first in range(0, H.shape[0], _CHUNK):
        part = H[first : first + _CHUNK]
        length = np.linalg.norm(part, axis=1, keepdims=True)
        scaled = np.divide(part, length, out=np.zeros_like(part), where=length > 0.0).reshape(-1, n_columns)
        squares += scaled.T @ scaled
    return np.asarray(np.linalg.eigh(squares)[1][:, 0], dtype=np.float64)


def _join(parts: list[Windows]) -> Windows | None:
    """Put the windows of several stretches one after the other."""
    if not parts:
        return None

    def together(name: str) -> AnyArray:
        return np.concatenate([getattr(part, name) for part in parts])

    return Windows(
        **{
            name: together(name)
            for name in (
                "time_s",
                "coefficients",
                "condition_number",
                "rank",
                "residual_rms",
                "singular_values",
                "noise_floor",
                "used",
            )
        },
        weakest=max(parts, key=lambda part: part.time_s.size).weakest,
        width=parts[0].width,
        stride=parts[0].stride,
        period_s=parts[0].period_s,
    )


def _noise_floor(column_rms: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the size that a singular value has in a direction of pure noise; shape (n_windows,).

    Columns are scaled to unit length, so each carries noise of length
    noise/rms; independent columns of such lengths have singular values near
    the root of their mean square. A column of noise only gives 1.
    """
    share = np.divide(noise, column_rms, out=np.ones_like(column_rms), where=column_rms > 0.0)
    return np.asarray(np.sqrt(np.mean(np.minimum(share, 1.0) ** 2, axis=1)), dtype=np.float64)
