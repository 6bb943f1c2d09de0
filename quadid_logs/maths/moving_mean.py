"""Means over a window that moves along the rows.

Not scipy.ndimage: importing it takes longer than these means.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from quadid_logs.arrays import FloatArray

#: What stands beyond the ends: zeros, the first and last row, or the rows mirrored there.
Beyond = Literal["zero", "edge", "mirrored"]
_PADDING: dict[Beyond, Literal["constant", "edge", "symmetric"]] = {
    "zero": "constant",
    "edge": "edge",
    "mirrored": "symmetric",
}


def moving_mean(columns: FloatArray, width: int, *, beyond: Beyond) -> FloatArray:
    """Return the mean over so many rows around each row.

    Parameters
    ----------
    columns : ndarray, shape (n,) or (n, n_columns)
    width : int
        Rows of a mean, at least 1; of an even number one more is before the row than behind it.
    beyond : {"zero", "edge", "mirrored"}
        What stands before the first and behind the last row.

    Returns
    -------
    ndarray, shape of `columns`

    Examples
    --------
    >>> moving_mean(np.array([0.0, 3.0, 6.0, 0.0]), 3, beyond="edge").tolist()
    [1.0, 3.0, 3.0, 2.0]
    """
    if width <= 1 or not len(columns):
        return columns
    before = width // 2
    ends = [(before, width - 1 - before)] + [(0, 0)] * (columns.ndim - 1)
    padded = np.pad(columns, ends, mode=_PADDING[beyond])
    # A sum of deviations stays small: its differences keep their digits.
    level = padded.mean(axis=0)
    total = np.zeros((len(padded) + 1, *columns.shape[1:]))
    np.cumsum(padded - level, axis=0, out=total[1:])
    return np.asarray(level + (total[width:] - total[:-width]) / width, dtype=np.float64)
