"""Which propeller shakes the gyro: the part of its signal that turns with each rotor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.health import Quantity
from quadid_logs.health.records import Record, records
from quadid_logs.maths.student import student_95, student_tail

#: The phase of a rotor is followed so long: its logged speed has errors [s].
_WINDOW_S: Final = 0.5
#: Speeds up to this fraction of the gyro's rate are seen.
_HIGHEST: Final = 0.45
#: Where the noise is measured, in turns of a window away from the rotors' mean: outside of their own lines.
_BESIDE: Final = (-6, -5, -4, -3, 3, 4, 5, 6)
#: Means of so many groups of windows are compared, whose neighbours may be alike (R. Ibragimov and
#: U. Mueller, Journal of Business & Economic Statistics 28, 2010).
_GROUPS: Final = 12


class Shaking(NamedTuple):
    """What each propeller shakes.

    Attributes
    ----------
    size : tuple of Quantity or None
        Of each rotor, root mean square over all axes [rad/s].
    worst : int
        The rotor that shakes more than all others together, -1 where none does.
    p_value : float
        That one seems to by chance.
    """

    size: tuple[Quantity | None, ...]
    worst: int
    p_value: float


def find_shaking(
    gyros: Sequence[CleanSeries], speed: CleanSeries | None, n_rotors: int, intervals: Sequence[Interval]
) -> Shaking | None:
    """Split what turns with the rotors among them.

    Parameters
    ----------
    gyros : sequence of CleanSeries
        Every source of the body rates.
    speed : CleanSeries or None
        Of each rotor [rad/s].

    Returns
    -------
    Shaking or None
        None where speeds are not logged, or are too fast for the log of the gyro.
    """
    if speed is None or speed.n_columns != n_rotors or not gyros:
        return None
    # Before its filters the gyro sees more of it.
    gyro = max(gyros, key=lambda one: (round(one.rate_hz) if one.rate_hz > 0.0 else 0, one.raw))
    flown = np.concatenate([speed.of_rows(speed.within(*one)) for one in intervals])
    flown = flown[np.isfinite(flown).all(axis=1)]
    if not len(flown) or not (np.median(flown, axis=0) > 0.0).all():
        return None
    if not float(np.percentile(flown, 95.0)) / (2.0 * np.pi) < _HIGHEST * gyro.rate_hz:
        return None
    found, period_s = records([gyro], intervals)
    width = round(_WINDOW_S / period_s)
    windows = [one for record in found for one in _windows(record, speed, width, period_s)]
    if len(windows) < 2 * _GROUPS:
        return None
    power = np.array([one for one, _ in windows])
    weight = 1.0 / np.array([one for _, one in windows]) ** 2
    return _compared(power, weight)


def _windows(
    record: Record, speed: CleanSeries, width: int, period_s: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return for each window the power that turns with each rotor, without that of noise, and its error."""
    values = speed.values
    speeds = np.column_stack([np.interp(record.time_s, speed.time_s, one) for one in values.T])
    found = []
    for begin in range(0, record.time_s.size - width + 1, width):
        part = slice(begin, begin + width)
        turned = speeds[part]
        if not np.isfinite(turned).all() or not (turned > 0.0).all():
            continue
        angle = np.cumsum(turned, axis=0) * period_s
        slow = np.asarray(np.vander(np.linspace(-1.0, 1.0, width), 6), dtype=np.float64)
        found.append(_of_window(angle, slow, record.values[part, :3]))
    return [one for one in found if one is not None]


def _of_window(
    angle: FloatArray, slow: FloatArray, rates: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    n_rotors = angle.shape[1]
    regressors = np.column_stack([np.cos(angle), np.sin(angle), slow])
    try:
        inverse = np.linalg.inv(regressors.T @ regressors)
    except np.linalg.LinAlgError:
        return None
    fitted = inverse @ (regressors.T @ rates)
    # The variance of white noise that has the density found beside the rotors' frequencies.
    rest, mean_angle = rates - regressors @ fitted, angle.mean(axis=1)
    n_samples = len(rest)
    turns = 2.0 * np.pi * np.arange(n_samples) / n_samples
    beside = np.exp(-1j * (mean_angle[:, np.newaxis] + turns[:, np.newaxis] * np.array(_BESIDE)))
    noise = float(np.sum(np.abs(beside.T @ rest) ** 2)) / (n_samples * len(_BESIDE))
    variance = np.diagonal(inverse)[: 2 * n_rotors].reshape(2, n_rotors).sum(axis=0)
    amplitudes = np.sum(fitted[: 2 * n_rotors].reshape(2, n_rotors, -1) ** 2, axis=(0, 2))
    # Half of the square of the amplitude is the mean square; noise has added its own.
    return 0.5 * (amplitudes - variance * noise), 0.5 * variance * noise


def _compared(power: FloatArray, weight: FloatArray) -> Shaking:
    """Hold each rotor against all others, over groups of windows."""
    n_rotors = power.shape[1]
    groups = np.array_split(np.arange(len(power)), _GROUPS)
    total = weight.sum(axis=0)
    mean = np.sum(weight * power, axis=0) / total
    by_group = np.array(
        [np.sum((weight * power)[rows], axis=0) / weight[rows].sum(axis=0) for rows in groups]
    )
    half = student_95(_GROUPS - 1) * by_group.std(axis=0, ddof=1) / np.sqrt(_GROUPS)
    size = tuple(
        Quantity(
            float(np.sqrt(max(one, 0.0))),
            "rad/s",
            (float(np.sqrt(max(one - wide, 0.0))), float(np.sqrt(max(one + wide, 0.0)))),
        )
        for one, wide in zip(mean, half, strict=True)
    )
    worst = int(np.argmax(mean))
    # Both that it shakes at all, and that it shakes more than the others together.
    p_value = 0.0
    for more in (by_group[:, worst], 2.0 * by_group[:, worst] - by_group.sum(axis=1)):
        error = float(more.std(ddof=1)) / np.sqrt(_GROUPS)
        if not (float(more.mean()) > 0.0 and error > 0.0):
            return Shaking(size, -1, 1.0)
        p_value = max(p_value, student_tail(float(more.mean()) / error, _GROUPS - 1))
    return Shaking(size, worst, min(1.0, n_rotors * p_value))
