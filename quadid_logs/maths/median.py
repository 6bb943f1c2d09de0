"""The median of few numbers, thousands of times."""

from __future__ import annotations

from quadid_logs.arrays import FloatArray


def median(values: FloatArray) -> float:
    """Return the median: `numpy.median` takes ten times as long for some hundred values.

    Parameters
    ----------
    values : ndarray, shape (n,)
        At least one, and none of them NaN.

    Returns
    -------
    float
    """
    n, middle = values.size, values.size // 2
    ordered = values.copy()
    ordered.partition(middle)
    high = float(ordered[middle])
    return high if n % 2 else 0.5 * (high + float(ordered[:middle].max()))
