"""The paper's windows: H_k at every k, with its condition number and rank."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.data.model import Windows
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.design import Design
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.sliding_windows import WindowSolution, solve_windows, stack_windows

#: Windows solved at once: 20 000 of 9x9 are 13 MB, so memory stays flat for any log.
_BATCH = 20_000
#: Windows of structures that the paper does not fix: of these lengths the shortest, which sees the model
#: change best, in which most windows see all directions above the noise.
_WINDOW_S = (0.5, 1.0, 2.0, 4.0, 8.0)
_MOST_OF_THEM = 0.5
#: The spread of a hundred thousand windows (four minutes at 400 Hz) is known
#: to some thousandths; more only cost time.
_MOST_WINDOWS = 100_000

Smooth = Sequence[tuple[FloatArray, dict[str, FloatArray]]]
"""Times and columns of every segment at its full rate, as `smooth_segment` returns them."""


class Chunk(NamedTuple):
    """A gap-free chunk: columns (n_samples, n_regressors), targets (n_samples, n_targets), uniform time."""

    columns: FloatArray
    targets: FloatArray
    time_s: FloatArray


def windows_on_rows(
    structure: Structure, design: Design, torque: FloatArray, settings: IdentifySettings, noise: FloatArray
) -> Windows | None:
    """Solve windows on the rows of a design, so long that most of them see more than noise.

    Parameters
    ----------
    structure : Structure
    design : Design
    torque : ndarray, shape (n_rows, n_inputs)
        Columns of ``structure.inputs``.
    settings : IdentifySettings
        ``window``, ``stride``.
    noise : ndarray, shape (n_columns,)
        Root mean square of the noise in each column.

    Returns
    -------
    Windows, or None if the flight is shorter than the shortest.
    """
    columns = design.stack(structure.columns, torque, structure.inputs)
    targets = np.column_stack([design.columns[name] for name in structure.targets])
    by_chunk = (design.chunk == number for number in np.unique(design.chunk))
    chunks = [Chunk(columns[rows], targets[rows], design.time_s[rows]) for rows in by_chunk]
    found = None
    for length_s in _WINDOW_S:
        width = settings.window or max(len(structure.columns), int(length_s / design.period_s))
        windows = solve_chunks(chunks, width=width, stride=settings.stride or max(1, width // 2), noise=noise)
        if windows is None:
            # Longer than the flight there are none: the last that there were must do.
            break
        found = windows
        if settings.window or np.mean(windows.used) >= _MOST_OF_THEM:
            break
    return found


def windows_at_full_rate(
    structure: Structure, smooth: Smooth, settings: IdentifySettings, noise: FloatArray
) -> Windows | None:
    """Solve the paper's windows: consecutive samples, every k (of very long flights, every so many).

    Parameters
    ----------
    structure : Structure
    smooth : sequence of (time_s, columns)
        Of every segment, as `smooth_segment` returns them.
    settings : IdentifySettings
        ``window``, ``stride``.
    noise : ndarray, shape (n_columns,)
        Root mean square of the noise in each column.

    Returns
    -------
    Windows, or None if all segments are shorter than one window.
    """
    width = settings.window or structure.width
    stride = settings.stride or max(1, int(np.ceil(sum(time_s.size for time_s, _ in smooth) / _MOST_WINDOWS)))
    chunks = (
        Chunk(
            np.column_stack([columns[name] for name in structure.columns]),
            np.column_stack([columns[name] for name in structure.targets]),
            time_s,
        )
        for time_s, columns in smooth
        if time_s.size >= max(width, 2)
    )
    return solve_chunks(chunks, width=width, stride=stride, noise=noise)


def solve_chunks(chunks: Iterable[Chunk], *, width: int, stride: int, noise: FloatArray) -> Windows | None:
    """Solve H_k theta = x_dot for the windows of several gap-free chunks.

    Parameters
    ----------
    chunks : iterable of Chunk
    width, stride : int
        Samples per window and between windows.
    noise : ndarray, shape (n_regressors,)
        Root mean square of the noise in each column.

    Returns
    -------
    Windows, or None if all chunks are shorter than one window.
    """
    solved = (_solve_chunk(chunk, width, stride, noise) for chunk in chunks)
    return _join([part for part in solved if part is not None])


def _solve_chunk(chunk: Chunk, width: int, stride: int, noise: FloatArray) -> Windows | None:
    """Solve the windows of one chunk; None if it is shorter than one."""
    columns, targets, time_s = chunk
    H = stack_windows(columns, width=width, stride=stride)
    if H.shape[0] == 0:
        return None
    Y = stack_windows(targets, width=width, stride=stride)
    batches = [
        solve_windows(H[first : first + _BATCH], Y[first : first + _BATCH])
        for first in range(0, H.shape[0], _BATCH)
    ]
    solution = WindowSolution(*(np.concatenate(part) for part in zip(*batches, strict=True)))
    noise_floor = _noise_floor(solution.column_rms, noise)
    full_rank = solution.rank == columns.shape[1]
    return Windows(
        time_s=time_s[: H.shape[0] * stride : stride] + 0.5 * (width - 1) * (time_s[1] - time_s[0]),
        coefficients=solution.coefficients,
        condition_number=solution.condition_number,
        rank=solution.rank,
        residual_rms=solution.residual_rms,
        singular_values=solution.singular_values,
        noise_floor=noise_floor,
        used=full_rank & (solution.singular_values[:, -1] > noise_floor),
        weakest=_weakest(H),
        width=width,
        stride=stride,
        period_s=float(time_s[1] - time_s[0]),
    )


def _weakest(H: FloatArray) -> FloatArray:
    """Return the direction that the windows, columns of each scaled to unit length, see least."""
    n_columns = H.shape[2]
    squares = np.zeros((n_columns, n_columns))
    for first in range(0, H.shape[0], _BATCH):
        part = H[first : first + _BATCH]
        length = np.linalg.norm(part, axis=1, keepdims=True)
        scaled = np.divide(part, length, out=np.zeros_like(part), where=length > 0.0).reshape(-1, n_columns)
        squares += scaled.T @ scaled
    return np.asarray(np.linalg.eigh(squares)[1][:, 0], dtype=np.float64)


def _join(parts: list[Windows]) -> Windows | None:
    """Put the windows of several chunks one after the other."""
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
    fraction = np.divide(noise, column_rms, out=np.ones_like(column_rms), where=column_rms > 0.0)
    return np.asarray(np.sqrt(np.mean(np.minimum(fraction, 1.0) ** 2, axis=1)), dtype=np.float64)
