"""Fewer points for the same picture."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray

#: Two points per bucket: more than the pixels of a full-width chart on a wide screen.
BUCKETS = 2000
#: Of series over time, a page carries more: what is drawn of them grows finer with the zoom.
CARRIED = 5 * BUCKETS // 2
#: A longer pause than so many periods is one.
PAUSE_PERIODS = 3.0


def thin_line(x: FloatArray, y: FloatArray, buckets: int = BUCKETS) -> tuple[FloatArray, FloatArray]:
    """Keep the lowest and the highest point of each of `buckets` equal intervals.

    No peak is lost, no point is moved, and a gap (NaN) stays a gap.

    Parameters
    ----------
    x, y : ndarray, shape (n_points,)

    Returns
    -------
    x, y : ndarray, shape (n_kept,)
        At most 4 * buckets + 4 points, in the same order.

    Examples
    --------
    >>> y = np.zeros(100_000)
    >>> y[777] = 9.0
    >>> kept = thin_line(np.arange(100_000.0), y, 10)[1]
    >>> bool(kept.max() == 9.0 and kept.size <= 44)
    True
    """
    n_points = y.shape[0]
    if n_points <= 2 * buckets:
        return x, y
    width = -(-n_points // buckets)
    missing = np.isnan(y)
    gaps = np.flatnonzero(missing)
    lowest, highest = (np.where(missing, np.inf, y), np.where(missing, -np.inf, y)) if gaps.size else (y, y)
    picks = (_in_rows(lowest, width).argmin(1), _in_rows(highest, width).argmax(1))
    rows = np.arange(picks[0].size) * width
    # Marked, not sorted: there are few points to a bucket.
    marked = np.zeros(n_points, dtype=np.bool_)
    for some in (rows + picks[0], rows + picks[1], [0, n_points - 1]):
        marked[some] = True
    kept = np.flatnonzero(marked)
    # Every gap between two points that stay must stay too, or a line would bridge it.
    following = np.searchsorted(gaps, kept)
    bridged = np.diff(following) > 0
    marked[gaps[following[:-1][bridged]]] = True
    return x[marked], y[marked]


def _in_rows(y: FloatArray, width: int) -> FloatArray:
    """Cut a series into rows; the last value fills the last row, and is found before its repetitions are."""
    return np.append(y, np.full(-y.size % width, y[-1])).reshape(-1, width)


def thin_points(
    x: FloatArray, y: FloatArray, cells: tuple[int, int] = (110, 60)
) -> tuple[FloatArray, FloatArray]:
    """Keep the first point in each cell of a grid over the data: a scatter looks the same.

    Points that are not finite are left out.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size <= cells[0]:
        return x, y
    cell = _cell(x, cells[0]) * cells[1] + _cell(y, cells[1])
    first = np.full(cells[0] * cells[1], -1)
    # Of all in a cell the first is written last.
    first[cell[::-1]] = np.arange(cell.size)[::-1]
    kept = np.sort(first[first >= 0])
    return x[kept], y[kept]


def _cell(values: FloatArray, n_cells: int) -> IntArray:
    """Return the number of the cell that each value falls into."""
    low, high = values.min(), values.max()
    fraction = (values - low) / (high - low if high > low else 1.0)
    return np.asarray(np.minimum(fraction * n_cells, n_cells - 1), dtype=np.int64)


def break_at_gaps(
    time_s: FloatArray, values: FloatArray, *, periods: float = PAUSE_PERIODS
) -> tuple[FloatArray, FloatArray]:
    """Put a NaN row into every pause of more than `periods` median periods.

    ``values`` has shape (n_samples, n_columns).
    """
    step_s = np.diff(time_s)
    forward = step_s[step_s > 0.0]
    if not forward.size:
        return time_s, values
    period_s = float(np.median(forward))
    after = np.flatnonzero(step_s > periods * period_s) + 1
    if not after.size:
        return time_s, values
    return np.insert(time_s, after, time_s[after - 1] + period_s), np.insert(values, after, np.nan, axis=0)
