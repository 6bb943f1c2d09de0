"""What Blackbox fields are, from what stands in them and what is predicted.

Source: the predictors of ``blackbox_fielddefs.h``. A complete frame predicts from itself, a frame of
differences from the two before it. All arithmetic is modulo 2^32, as in the firmware; all runs between
complete frames are worked out at once, one step of each at a time.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import IntArray
from quadid_logs.containers.blackbox_header import Header, Layout

Int32Array: TypeAlias = NDArray[np.int32]

_PREVIOUS, _LINE, _AVERAGE, _MIN_THROTTLE, _FIRST_MOTOR, _INCREMENT = 1, 2, 3, 4, 5, 6
_HOME, _MIDDLE, _VBAT_REFERENCE, _MAIN_TIME, _LOWEST_OUTPUT = 7, 8, 9, 10, 11
_MIDDLE_PULSE_US: Final = 1500
_MOTOR_0: Final = "motor[0]"
_DIFFERENCES: Final = (_PREVIOUS, _LINE, _AVERAGE, _INCREMENT)


def add_constants(values: Int32Array, layout: Layout, header: Header) -> None:
    """Add the predictions that come from the header or the same frame.

    Parameters
    ----------
    values : ndarray of int32, shape (n_fields, n_frames)
        Changed in place.
    """
    constants = {
        _MIN_THROTTLE: header.number("minthrottle"),
        _MIDDLE: _MIDDLE_PULSE_US,
        _VBAT_REFERENCE: header.number("vbatref"),
        _LOWEST_OUTPUT: header.number("motorOutput"),
    }
    for number, predictor in enumerate(layout.predictor):
        if predictor in constants:
            values[number] += np.array(constants[predictor], np.int64).astype(np.int32)
    first = layout.names.index(_MOTOR_0) if _MOTOR_0 in layout.names else None
    for number, predictor in enumerate(layout.predictor):
        if predictor == _FIRST_MOTOR and first is not None and first != number:
            values[number] += values[first]


def add_differences(values: Int32Array, is_complete: NDArray[np.bool_], header: Header) -> None:
    """Add up the differences behind each complete frame.

    Parameters
    ----------
    values : ndarray of int32, shape (n_frames, n_fields)
        In file order, the first one complete; changed in place.
    is_complete : ndarray of bool, shape (n_frames,)
    """
    predictor = np.array(header.layouts["P"].predictor)
    first = np.flatnonzero(is_complete)
    length = np.diff(np.append(first, len(values)))
    order = np.argsort(-length, kind="stable")
    first, length = first[order], length[order]
    columns = {kind: _as_slice(np.flatnonzero(predictor == kind)) for kind in _DIFFERENCES}
    step_of = _steps(header) if (predictor == _INCREMENT).any() else np.zeros(1, np.int32)
    last = earlier = values[first]
    for step in range(1, int(length.max(initial=0))):
        # The longest runs come first, so those that go on are the first rows of the last step.
        now = first[: np.searchsorted(-length, -step, side="left")] + step
        before, earlier = last[: len(now)], earlier[: len(now)]
        row = values[now]
        row[:, columns[_PREVIOUS]] += before[:, columns[_PREVIOUS]]
        line, average, counter = columns[_LINE], columns[_AVERAGE], columns[_INCREMENT]
        row[:, line] += 2 * before[:, line] - earlier[:, line]
        total = before[:, average] + earlier[:, average]
        # Halves are cut off towards zero.
        row[:, average] += (total + (total < 0)) >> 1
        row[:, counter] += before[:, counter] + step_of[before[:, counter] % len(step_of)]
        values[now] = row
        last, earlier = row, before


def _as_slice(columns: IntArray) -> slice | IntArray:
    """Return columns that stand together as a slice, which numpy copies several times faster."""
    if len(columns) and columns[-1] - columns[0] == len(columns) - 1:
        return slice(int(columns[0]), int(columns[-1]) + 1)
    return columns


def _steps(header: Header) -> Int32Array:
    """Return by loop, modulo the interval of complete frames, how many loops later the next frame is."""
    interval = header.sampling.complete
    logged = np.flatnonzero(header.sampling.is_logged(np.arange(1, 2 * interval + 1)) | (
        np.arange(1, 2 * interval + 1) % interval == 0)) + 1  # fmt: skip
    loop = np.arange(interval)
    return (logged[np.searchsorted(logged, loop, side="right")] - loop).astype(np.int32)


def add_places(values: Int32Array, layout: Layout, home: Int32Array, main_time: Int32Array) -> None:
    """Add the home position and the last main frame's time to frames of a receiver.

    Parameters
    ----------
    values : ndarray of int32, shape (n_fields, n_frames)
        Changed in place.
    home : ndarray of int32, shape (2, n_frames)
    main_time : ndarray of int32, shape (n_frames,)
    """
    n_home = 0
    for number, predictor in enumerate(layout.predictor):
        if predictor == _HOME:
            values[number] += home[n_home % 2]
            n_home += 1
        elif predictor == _MAIN_TIME:
            values[number] += main_time
