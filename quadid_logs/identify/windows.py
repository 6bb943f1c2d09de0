"""The paper's windows: H_k at every k, with its condition number and rank."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Windows
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.design import Design, n_smoothed, smooth_segment
from quadid_logs.identify.structures import Structure
from quadid_logs.maths.sliding_windows import solve_windows, stack_windows

#: Windows solved at once: 20 000 of 9x9 are 13 MB, so memory stays flat for any log.
_BATCH = 20_000
#: Windows of structures that the paper does not fix: of these lengths the shortest, which sees the model
#: change best, in which most windows see all directions above the noise.
_WINDOW_S = (0.5, 1.0, 2.0, 4.0, 8.0)
_MOST_OF_THEM = 0.5
#: The spread of n windows that do not overlap is known to 1 / sqrt(2 n): of so many to half a per cent. Those
#: that overlap tell little of their own.
_MOST_WINDOWS = 20_000


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
    structure: Structure,
    data: FlightData,
    smoothing_hz: float,
    settings: IdentifySettings,
    noise: FloatArray,
) -> Windows | None:
    """Solve the paper's windows: consecutive samples, every k (of very long flights, every so many).

    Parameters
    ----------
    structure : Structure
    data : FlightData
        Its segments are smoothed one after the other, and only as far as this structure needs it.
    smoothing_hz : float
        Cut-off of the Gaussian [Hz].
    settings : IdentifySettings
        ``window``, ``stride``.
    noise : ndarray, shape (n_columns,)
        Root mean square of the noise in each column.

    Returns
    -------
    Windows, or None if all segments are shorter than one window.
    """
    width = settings.window or structure.width
    lengths = [n_smoothed(each, data.sample_period_s, smoothing_hz) for each in data.segments]
    stride = settings.stride or max(1, int(np.ceil(sum(lengths) / _MOST_WINDOWS)))
    n_columns = len(structure.columns)
    names = (*structure.columns, *structure.targets)
    smooth = (
        smooth_segment(each, data.sample_period_s, smoothing_hz, names, structure.terms)
        for each, length in zip(data.segments, lengths, strict=True)
        if length >= max(width, 2)
    )
    chunks = (Chunk(columns[:, :n_columns], columns[:, n_columns:], time_s) for time_s, columns in smooth)
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
    solved = [part for chunk in chunks for part in _solved(chunk, width, stride, noise)]
    if not solved:
        return None
    weakest = max(solved, key=lambda part: part.n_in_chunk).weakest
    columns = [part.columns for part in solved]
    period_s = solved[0].period_s
    del solved
    # What is put together is taken out of the parts: of many windows there is no room for both.
    together = {name: np.concatenate([part.pop(name) for part in columns]) for name in [*columns[0]]}
    return Windows(**together, weakest=weakest, width=width, stride=stride, period_s=period_s)


class _Part(NamedTuple):
    """Some windows of a chunk: what `Windows` has of each, by name, and what they have in common."""

    columns: dict[str, AnyArray]
    weakest: FloatArray
    n_in_chunk: int
    period_s: float


def _solved(chunk: Chunk, width: int, stride: int, noise: FloatArray) -> Iterator[_Part]:
    """Yield the windows of one chunk, so many at once as memory stays flat with; none if it is shorter."""
    columns, targets, time_s = chunk
    H = stack_windows(columns, width=width, stride=stride)
    if H.shape[0] == 0:
        return
    Y = stack_windows(targets, width=width, stride=stride)
    # The direction that the windows, columns of each scaled to unit length, see least.
    n_columns = H.shape[2]
    squares = np.zeros((n_columns, n_columns))
    for first in range(0, H.shape[0], _BATCH):
        some = H[first : first + _BATCH]
        length = np.linalg.norm(some, axis=1, keepdims=True)
        scaled = np.divide(some, length, out=np.zeros_like(some), where=length > 0.0).reshape(-1, n_columns)
        squares += scaled.T @ scaled
    weakest, period_s = np.linalg.eigh(squares)[1][:, 0], float(time_s[1] - time_s[0])
    middle_s = time_s[: H.shape[0] * stride : stride] + 0.5 * (width - 1) * (time_s[1] - time_s[0])
    for first in range(0, H.shape[0], _BATCH):
        part = slice(first, first + _BATCH)
        solution = solve_windows(H[part], Y[part])
        # Columns are scaled to unit length, so each carries noise of length noise/rms; independent columns of
        # such lengths have singular values near the root of their mean square. A column of noise only gives
        # 1.
        column_rms = solution.column_rms
        fraction = np.divide(noise, column_rms, out=np.ones_like(column_rms), where=column_rms > 0.0)
        noise_floor = np.sqrt(np.mean(np.minimum(fraction, 1.0) ** 2, axis=1))
        full_rank = solution.rank == columns.shape[1]
        found = {
            "coefficients": solution.coefficients,
            "singular_values": solution.singular_values,
            "residual_rms": solution.residual_rms,
            "condition_number": solution.condition_number,
            "rank": solution.rank,
            "time_s": middle_s[part],
            "noise_floor": noise_floor,
            "used": full_rank & (solution.singular_values[:, -1] > noise_floor),
        }
        yield _Part(found, weakest, H.shape[0], period_s)
