"""A chirp that a test mode injects into one axis after the other, told apart by the axis that it drives."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.vocabulary import AXES

#: Between two sweeps a pilot or a script waits for seconds; within one nothing rests.
_REST_S: Final = 0.5


def by_driven_axis(commands: FloatArray, torque: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the commands, a chirp as three columns: each run in that of the axis whose torque it moves most.

    In one column the law from chirp to torque would be another one in each run, and what one run tells of
    an axis would be expected of all others.

    Parameters
    ----------
    commands : ndarray, shape (n_samples, 3 or 4)
        Set-points of the three axes, and a chirp where there is one.
    torque : ndarray, shape (n_samples, 3)
    time_s : ndarray, shape (n_samples,)

    Returns
    -------
    ndarray, shape (n_samples, 3 or 6)
    """
    if commands.shape[1] <= len(AXES):
        return commands
    chirp = commands[:, len(AXES)]
    apart = np.zeros((chirp.size, len(AXES)))
    # Where it is not known what was commanded, nothing is: in each column.
    apart[~np.isfinite(chirp)] = np.nan
    # Rests divide the runs of a chirp; its zero crossings do not.
    moving = np.flatnonzero(np.nan_to_num(chirp))
    runs = np.split(moving, np.flatnonzero(np.diff(time_s[moving]) > _REST_S) + 1) if moving.size else []
    for rows in runs:
        run = slice(int(rows[0]), int(rows[-1]) + 1)
        # A run ends where the chirp is not known.
        if not np.isfinite(chirp[run]).all():
            continue
        moved = torque[run] - torque[run].mean(axis=0)
        size = np.sqrt(np.sum(moved**2, axis=0)) + np.finfo(float).tiny
        apart[run, int(np.argmax(np.abs(chirp[run] @ moved) / size))] = chirp[run]
    return np.column_stack([commands[:, : len(AXES)], apart])
