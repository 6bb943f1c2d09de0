"""Two vehicles behind one model: two flights that differ, a rotor that lost thrust. Intervals hold both."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import Rotors
from quadid_logs.data.model import Identification, Model
from quadid_logs.identify.splice import with_interval
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
    for axis, name in enumerate(AXES):
        gain, half_width = check.flight_gain[:, axis], check.flight_half_width[:, axis]
        old = model.entries[ON_AXIS[name]]
        if not (old.value and np.isfinite(old.ci95).all() and (common or _differ(gain, half_width))):
            continue
        low, high = (
            old.value * _farthest(gain, half_width, end / old.value, side if old.value > 0.0 else -side)
            for side, end in zip((-1.0, 1.0), old.ci95, strict=True)
        )
        model = with_interval(model, axis, (low, high))
    return model


def with_lost_thrust(identification: Identification, rotors: Rotors | None) -> Identification:
    """Widen the intervals to hold the vehicle before and the one after a rotor lost thrust.

    The fit lies somewhere between both, by how much of the manoeuvre was flown with each.

    Parameters
    ----------
    identification : Identification
    rotors : Rotors or None
        What the flight tells of each rotor.

    Returns
    -------
    Identification
        As it is where the balance of the rotors did not move.
    """
    if rotors is None or not rotors.axes_change:
        return identification
    ratio = [change.value for change in rotors.axes_change]
    found = []
    for model in identification.models:
        for axis, (name, after) in enumerate(zip(AXES, ratio, strict=True)):
            entry = model.entries[ON_AXIS[name]]
            if np.isfinite(entry.ci95).all() and 0.0 < after < 1.0:
                ends = [end * factor for end in entry.ci95 for factor in (after, 1.0, 1.0 / after)]
                model = with_interval(model, axis, (min(ends), max(ends)))
        found.append(model)
    return replace(identification, models=tuple(found))


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
