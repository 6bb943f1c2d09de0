"""The change of effectiveness in flight that a fit in time shows, as answers to commands tell it.

Gusts come back in the torque through the controller, and lower the effectiveness of a fit in time. Gusts that
grow or calm down move it where no vehicle has changed. What answers to commands is free of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.data.model import ChangeCheck, Model, SpectralFit
from quadid_logs.identify.checks import before_and_after
from quadid_logs.identify.spectral import BLOCK_S, AxisMoments, SharedActuator, moment_noise
from quadid_logs.identify.splice import with_interval
from quadid_logs.vocabulary import AXES, ON_AXIS

_TINY: Final = float(np.finfo(np.float64).tiny)


class _Part(NamedTuple):
    """Of some blocks: effectiveness over that of all, variance by noise, and the weight of each band."""

    gain: float
    variance: float
    weight: FloatArray


def with_answers(model: Model, axes: Sequence[AxisMoments], fits: Sequence[SpectralFit]) -> Model:
    """Return a model whose changes of effectiveness are those that answers to commands tell.

    Parameters
    ----------
    model : Model
        Its `Model.change` is that of the fit in time.
    axes : sequence of AxisMoments
        Those whose effectiveness is that of their answers to commands.
    fits : sequence of SpectralFit
        Of roll, pitch, yaw.

    Returns
    -------
    Model
        Intervals hold what was before and after a change that is seen.
    """
    if model.change is None:
        return model
    change = answered(model.change, axes, fits)
    model = replace(model, change=change)
    for number in (axis.number for axis in axes if change.seen[axis.number]):
        first, last = before_and_after(change, number)
        low, high = model.entries[ON_AXIS[AXES[number]]].ci95
        model = with_interval(model, number, (min(low, first), max(high, last)))
    return model


def answered(change: ChangeCheck, axes: Sequence[AxisMoments], fits: Sequence[SpectralFit]) -> ChangeCheck:
    """Return the changes that a fit in time shows as answers to commands tell them.

    Parameters
    ----------
    change : ChangeCheck
        Of the fit in time.
    axes, fits
        As of `with_answers`.

    Returns
    -------
    ChangeCheck
        At the times of the fit in time; as it was on all other axes.
    """
    before, after, statistic = change.before.copy(), change.after.copy(), change.statistic.copy()
    for axis in axes:
        number, fit = axis.number, fits[axis.number]
        later = axis.start_s + 0.5 * BLOCK_S > change.time_s[number]
        if later.all() or not later.any() or not fit.gain:
            statistic[number] = np.nan
            continue
        first, last = _parts(axis, SharedActuator.of(fit), ~later, later)
        # What one gain, lag and delay do not describe is the same in both, at the same frequencies.
        weight = (last.weight - first.weight) * np.sqrt(axis.variance_of_departure())
        variance = first.variance + last.variance + float(weight @ axis.alike @ weight)
        before[number], after[number] = fit.gain * first.gain, fit.gain * last.gain
        statistic[number] = (last.gain - first.gain) ** 2 / max(variance, _TINY)
    return replace(change, before=before, after=after, statistic=statistic)


def _parts(axis: AxisMoments, actuator: SharedActuator, *parts: BoolArray) -> list[_Part]:
    """Return the effectiveness of some blocks, each (n_blocks,), with each band by what is known of it."""
    theta = axis.solved(actuator)[0]
    acting, error = axis.acting(actuator), axis.error(theta, actuator)
    found = []
    for rows in parts:
        instrument = axis.instrument * rows[:, np.newaxis]
        moved, left = (axis.summed((instrument.conj() * each).sum(axis=0)) for each in (acting, error))
        noise = 0.5 * (moment_noise(axis, instrument, error) + axis.elsewhere(instrument))
        size = np.maximum(np.abs(moved), np.sqrt(_TINY))
        # Without its turn, the moment of the torque is real.
        along = np.real(left * np.exp(-1j * np.angle(moved))) / theta[0]
        of_noise = noise / (theta[0] * size) ** 2
        known = 1.0 / (of_noise + axis.variance_of_departure())
        weight = known / known.sum()
        found.append(_Part(1.0 + float(weight @ (along / size)), float(np.sum(weight**2 * of_noise)), weight))
    return found
