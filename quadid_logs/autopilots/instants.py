"""A flight by a few instants of which each counts alike: what moves with its rotors is averaged over them."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray

#: Instants by which a flight stands.
_N_INSTANTS: Final = 9
#: Of the speed that is exceeded in a tenth of the rows: slower rotors have less than a quarter of its thrust.
_IN_FLIGHT: Final = 0.5


def instants(values: FloatArray) -> FloatArray:
    """Return rows of a flight that stand for all of it.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        What is not finite counts as zero.

    Returns
    -------
    ndarray, shape (n_instants, n_columns)
        By their mean from low to high, each for as many rows; none where all is zero. Columns that are
        always zero are left out.
    """
    values = np.where(np.isfinite(values), values, 0.0).astype(np.float64)
    values = values[:, (values > 0.0).any(axis=0)]
    if not values.size:
        return np.zeros((0, 0))
    mean = values.mean(axis=1)
    flying = np.flatnonzero(mean >= _IN_FLIGHT * np.quantile(mean, 0.9))
    order = flying[np.argsort(mean[flying], kind="stable")]
    places = (np.arange(_N_INSTANTS) + 0.5) / _N_INSTANTS * order.size
    return values[order[places.astype(np.int64)]]
