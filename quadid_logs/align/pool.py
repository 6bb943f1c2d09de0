"""Several logs of one vehicle as one flight."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.log import NO_GYRO_FILTER
from quadid_logs.errors import SettingsError

#: Pause between two logs on the common clock [s]: far longer than any gap that is bridged.
_BETWEEN_S = 60.0
#: Periods that differ by less than rounding are one.
_SAME_PERIOD = 1e-6


def pool(flights: Sequence[FlightData]) -> FlightData:
    """Put aligned logs one after the other on the clock of the first.

    Parameters
    ----------
    flights : sequence of FlightData
        Of one sample period. Those without segments add nothing.

    Returns
    -------
    FlightData
        Sources, overview and texts are those of the first log; segments and
        flights are those of all, each shifted to begin a minute after the log
        before it ended. Its duration is that of all logs, without the minutes between.

    Raises
    ------
    SettingsError
        If the logs were resampled to different periods, or their torque is
        not the same quantity.
    """
    first, *others = (each for each in flights if each.segments)
    merged, end_s = first, first.start_s + first.duration_s
    for other in others:
        # Refuse logs whose numbers do not mean the same.
        if abs(first.sample_period_s - other.sample_period_s) > _SAME_PERIOD * first.sample_period_s:
            raise SettingsError(
                f"The logs were resampled to {1.0 / first.sample_period_s:.4g} and "
                f"{1.0 / other.sample_period_s:.4g} Hz.",
                hint="Set one rate for all logs with --sample-rate-hz.",
            )
        if first.input is None or other.input is None or first.input.unit != other.input.unit:
            raise SettingsError(
                "One log holds torque in N m, the other a normalised command.",
                hint="Pool only logs of one vehicle that were logged in the same way.",
            )
        shift_s = end_s + _BETWEEN_S - other.start_s
        end_s += _BETWEEN_S + other.duration_s
        n_flights = len(merged.flights)
        merged = replace(
            merged,
            segments=(
                *merged.segments,
                *(
                    replace(each, time_s=each.time_s + shift_s, flight=each.flight + n_flights)
                    for each in other.segments
                ),
            ),
            flights=(*merged.flights, *((a + shift_s, b + shift_s) for a, b in other.flights)),
            duration_s=merged.duration_s + other.duration_s,
            clock_resets=merged.clock_resets + other.clock_resets,
            gyro_filter=merged.gyro_filter if merged.gyro_filter == other.gyro_filter else NO_GYRO_FILTER,
        )
    return replace(merged, input=_joint_input(merged, [first, *others]))


def copies(flights: Sequence[FlightData]) -> dict[int, int]:
    """Tell which logs hold the flights of another one: counted twice, they would know too much.

    Parameters
    ----------
    flights : sequence of FlightData

    Returns
    -------
    dict of int to int
        By the place of a copy the place of the first log that holds the same rates and torque.
    """
    first: dict[bytes, int] = {}
    found = {}
    for place, each in enumerate(flights):
        if each.segments:
            told = hashlib.sha256()
            for segment in each.segments:
                told.update(segment.body_rate_rad_s.tobytes() + segment.torque.tobytes())
            if (before := first.setdefault(told.digest(), place)) != place:
                found[place] = before
    return found


def _joint_input(merged: FlightData, parts: Sequence[FlightData]) -> InputDescription | None:
    """Describe the input of all: saturation by its fraction, achieved and every step only if every log is."""
    if merged.input is None:
        return None
    described = [each.input for each in parts if each.input is not None]
    expo = merged.input.expo
    n_samples = [each.n_samples for each in parts]
    saturated = [each.saturated_fraction for each in described]
    limited = np.average([each.limited_fraction for each in described], axis=0, weights=n_samples)
    roll, pitch, yaw = limited.tolist()
    return replace(
        merged.input,
        saturated_fraction=float(np.average(saturated, weights=n_samples)),
        limited_fraction=(roll, pitch, yaw),
        achieved=all(each.achieved for each in described),
        every_step=all(each.every_step for each in described),
        grid=max(each.grid for each in described),
        # Of logs rebuilt with different curves no one expo is to be found.
        expo=expo if all(each.expo == expo for each in described) else None,
    )
