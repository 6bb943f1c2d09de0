"""Two flights of one log whose effectiveness differs: what is told of an axis holds both."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Model
from quadid_logs.maths.random_effect import random_effect
from quadid_logs.vocabulary import AXES, ON_AXIS

#: Flights that are alike look so different in one case of twenty, and are then told a little too widely.
_ALIKE: Final = 0.05


def of_all_axes(gain: FloatArray, half_width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each flight's effectiveness about all axes together: battery, load and air change all alike.

    Parameters
    ----------
    gain, half_width : ndarray, shape (n_flights, 3)
        Effectiveness over that of all flights, and half of its 95 % interval.

    Returns
    -------
    gain, half_width : ndarray, shape (n_flights,)
        NaN where nothing is known.
    """
    weight = np.where(np.isfinite(gain) & (half_width > 0.0), half_width, np.inf) ** -2.0
    known = weight.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.sum(weight * np.nan_to_num(gain), axis=1) / known
        return np.where(known > 0.0, mean, np.nan), np.where(known > 0.0, known**-0.5, np.nan)


def with_flights_beside(model: Model) -> Model:
    """Widen the interval of each effectiveness to hold that of both flights, where two flights differ.

    Parameters
    ----------
    model : Model

    Returns
    -------
    Model
        As it is where the log holds one flight, or two that are alike. What lies between more of them is in
        the interval already (`identify.structural`).
    """
    check = model.structural
    if check is None or len(check.flight_gain) != 2:
        return model
    common = _differ(*of_all_axes(check.flight_gain, check.flight_half_width))
    parameters = list(model.parameters)
    for axis, name in enumerate(AXES):
        gain, half_width = check.flight_gain[:, axis], check.flight_half_width[:, axis]
        old = model.entries[ON_AXIS[name]]
        if not (old.value and np.isfinite(old.ci95).all() and (common or _differ(gain, half_width))):
            continue
        low, high = (
            old.value * _farthest(gain, half_width, end / old.value, side if old.value > 0.0 else -side)
            for side, end in zip((-1.0, 1.0), old.ci95, strict=True)
        )
        new = replace(old, ci95=(low, high))
        parameters = [new if each is old else each for each in parameters]
    return replace(model, parameters=tuple(parameters))


def _differ(gain: FloatArray, half_width: FloatArray) -> bool:
    return bool(np.isfinite(gain).any()) and random_effect(gain, half_width).p_value < _ALIKE


def _farthest(gain: FloatArray, half_width: FloatArray, end: float, side: float) -> float:
    """Return the farthest end of the intervals of flights, each as far beyond its flight as that of all.

    Gyros, and what else all flights have in common, are in the interval of all, which ends at ``end`` over
    the effectiveness; ``side`` is -1 below and 1 above. A flight of which nothing is known moves nothing.
    """
    known = np.isfinite(gain) & np.isfinite(half_width)
    ends = gain[known] + side * np.hypot(half_width[known], end - 1.0)
    return side * float(np.max(side * ends, initial=side * end))
