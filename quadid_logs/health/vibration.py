"""How much the vehicle shakes, and how often the accelerometer was at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.data.health import Level, Quantity, Vibration
from quadid_logs.health.records import Record, averaged, in_flight, records
from quadid_logs.numerals import number
from quadid_logs.vocabulary import GRAVITY_M_S2

_Measure = Literal["vibration", "vibration_level", "specific_force"]


class _Measured(NamedTuple):
    """A signal, what it is in words, and where its published levels begin [m/s^2]."""

    name: _Measure
    words: str
    limits: tuple[float, ...]


_MEASURES: Final = (
    # Below 30 m/s^2 normally acceptable, above 60 nearly always problems (source: docs/health.md).
    _Measured("vibration", "The vibration that the autopilot measured", (30.0, 60.0)),
    # Green below 4.905, red above 9.81 (source: docs/health.md).
    _Measured("vibration_level", "The autopilot's vibration metric", (4.905, 9.81)),
    # Behind a low-pass, or averaged: nothing published says what is normal.
    _Measured("specific_force", "The vibration above 5 Hz in the logged acceleration", ()),
)
#: Autopilots measure vibration against the acceleration below this, too (docs/health.md) [Hz].
_ABOVE_HZ: Final = 5.0
#: Zero is ideal, below 100 in a flight is probably all right (source: docs/health.md).
_MOST_CLIPS: Final = 100.0
_FEWEST: Final = 10
#: Ranges of accelerometers on flight controllers: MPU-6000 and ICM-20xxx to 16 g, BMI088 24, ICM-45686 32 g.
_RANGES_G: Final = (4.0, 8.0, 16.0, 24.0, 32.0)
#: Calibrated scales differ from one by about this; equal readings by the rounding of single precision.
_SAME_RANGE, _SAME_STEP = 0.02, 1e-4


def find_vibration(
    signals: Mapping[str, CleanSeries],
    clipping: Sequence[CleanSeries],
    intervals: Sequence[Interval],
    sensors: Mapping[str, Sequence[CleanSeries]] = MappingProxyType({}),
) -> Vibration | None:
    """Take the best measure of vibration that the log holds.

    Parameters
    ----------
    signals : mapping of str to CleanSeries
        By canonical name.
    clipping : sequence of CleanSeries
        Counts since the start, of every sensor.
    intervals : sequence of (start_s, end_s)
        Of flight.
    sensors : mapping of str to sequence of CleanSeries
        By name, every sensor's; the worst is shown.

    Returns
    -------
    Vibration or None
        None where no accelerometer was logged in flight.
    """
    counted = True
    for measured in _MEASURES:
        series = signals.get(measured.name)
        if series is None:
            continue
        record = None if measured.limits else _shaking(series, intervals)
        if measured.limits:
            found = [in_flight(one, intervals) for one in sensors.get(measured.name) or (series,)]
            # Of the sensor that shakes most: what 99 % of the flight stay below, along the worst axis.
            record = max(
                [one for one in found if len(one.time_s) >= _FEWEST] or found,
                key=lambda one: (
                    float(np.percentile(one.values, 99.0, axis=0).max()) if one.values.size else 0.0
                ),
            )
        if record is None or len(record.time_s) < _FEWEST:
            continue
        if record.values.any():
            clips = _clips(clipping, intervals) if counted else None
            return _judged(measured, record, clips or _at_the_end(signals.get("specific_force"), intervals))
        # Without a measurement the autopilot logs zeros, of clipping too.
        counted = False
    return None


def _judged(measured: _Measured, record: Record, clips: Quantity | None) -> Vibration:
    high = np.percentile(record.values, 99.0, axis=0)
    worst = int(np.argmax(high))
    value = float(high[worst])
    columns = ("x", "y", "z")[: record.values.shape[1]] if record.values.shape[1] > 1 else ("",)
    level: Level = "fact"
    if measured.limits:
        level = ("normal", "high", "severe")[int(np.searchsorted(measured.limits, value))]
    normal = (0.0, measured.limits[0]) if measured.limits else None
    if clips is not None and clips.normal is not None and clips.value > clips.normal[1]:
        level = "severe" if level == "severe" else "high"
    short = averaged(record)
    column = columns[worst]
    axis = f" along {column}" if column else ""
    told = f"{measured.words} stays below {number(value, 3)} m/s²{axis} in 99 % of the flight"
    if measured.limits:
        normal_end, severe_end = measured.limits
        if value <= normal_end:
            told += f", which is normal (up to {normal_end:.3g})"
        elif value <= severe_end:
            told += f". The normal limit is {normal_end:.3g}"
        else:
            told += f". The normal limit is {normal_end:.3g}, which is far lower"
    if clips is None:
        told = f"{told}."
    elif clips.value == 0.0:
        told = f"{told}. The accelerometer never clipped."
    else:
        judged = "" if clips.value <= _MOST_CLIPS else ". Normal is up to 100 times in a flight"
        told = f"{told}. The accelerometer clipped {clips.value:.0f} times{judged}."
    return Vibration(
        findings=("QL435",) if clips is not None and clips.value > _MOST_CLIPS else (),
        sentence=told,
        level=level,
        measure=measured.name,
        columns=columns,
        figure=Quantity(value, "m/s^2", normal=normal),
        limits=measured.limits,
        clips=clips,
        time_s=short.time_s,
        values=short.values,
    )


def _shaking(series: CleanSeries, intervals: Sequence[Interval]) -> Record | None:
    """Return the rms over half seconds of what an acceleration moves above 5 Hz, by axis.

    The log's own samples, not averages of them: what is faster than half their rate is in their spread all
    the same.
    """
    n_half = round(0.5 * series.rate_hz)
    if 0.5 * series.rate_hz <= _ABOVE_HZ or n_half < 4:
        return None
    found, _ = records([series], intervals)
    width = max(3, round(series.rate_hz / _ABOVE_HZ))
    times, values = [], []
    for one in found:
        n_blocks = (one.time_s.size - width) // n_half
        if n_blocks < 1:
            continue
        sums = np.cumsum(np.vstack([np.zeros(one.values.shape[1]), one.values]), axis=0)
        slow = (sums[width:] - sums[:-width]) / width
        fast = one.values[width // 2 : width // 2 + len(slow)] - slow
        blocks = fast[: n_blocks * n_half].reshape(n_blocks, n_half, -1)
        values.append(np.sqrt(np.mean(blocks**2, axis=1)))
        times.append(one.time_s[width // 2] + (0.5 + np.arange(n_blocks)) * n_half * series.period_s)
    return Record(np.concatenate(times), np.concatenate(values)) if times else None


def _clips(counts: Sequence[CleanSeries], intervals: Sequence[Interval]) -> Quantity | None:
    """Return how many samples were clipped in flight, of the sensor with most."""
    # By how much counters rose; one that starts again counts from there.
    found = [
        float(np.clip(np.diff(values, axis=0), 0.0, None).sum(axis=0).max())
        for one in counts
        for interval in intervals
        if len(values := one.of_rows(one.within(*interval))) >= 2
    ]
    return Quantity(max(found), "1", normal=(0.0, _MOST_CLIPS)) if found else None


def _at_the_end(force: CleanSeries | None, intervals: Sequence[Interval]) -> Quantity | None:
    """Count the samples at the end of a common range, where nobody counted them; None where there are none.

    A filter behind the sensor hides them, and a range that is not known is not found: none is no proof.
    """
    if force is None:
        return None
    record = in_flight(force, intervals)
    values = np.abs(record.values[np.isfinite(record.values).all(axis=1)])
    if not values.size:
        return None
    highest = float(values.max())
    if not any(abs(highest / (full * GRAVITY_M_S2) - 1.0) < _SAME_RANGE for full in _RANGES_G):
        return None
    clipped = int(np.count_nonzero((values >= highest * (1.0 - _SAME_STEP)).any(axis=1)))
    return Quantity(float(clipped), "1", normal=(0.0, _MOST_CLIPS)) if clipped >= _FEWEST else None
