"""Names for the array types that travel through the package, and rows by the block."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
AnyArray = NDArray[Any]

#: What is worked out on the way to a result fits into the processor's cache.
_BLOCK_ROWS: Final = 1 << 16


def row_blocks(n_rows: int) -> Iterator[slice]:
    """Yield all rows by the block: what is needed on the way to a result is then not as large as the log.

    Examples
    --------
    >>> [(rows.start, rows.stop) for rows in row_blocks(100_000)]
    [(0, 65536), (65536, 100000)]
    """
    for first in range(0, n_rows, _BLOCK_ROWS):
        yield slice(first, min(first + _BLOCK_ROWS, n_rows))


def runs(mask: ArrayLike) -> list[tuple[int, int]]:
    """Return first index and index after the last of each run where a mask holds.

    Parameters
    ----------
    mask : array-like of bool, shape (n,)

    Examples
    --------
    >>> runs([True, True, False, True])
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=np.int8), prepend=0, append=0))
    return [(first, after) for first, after in edges.reshape(-1, 2).tolist()]
