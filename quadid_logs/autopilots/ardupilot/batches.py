"""Batches of gyro samples, as INS_LOG_BAT_MASK logs them: a header (ISBH), and rows of 32 samples (ISBD).

Source: AP_InertialSensor/BatchSampler.cpp and AP_InertialSensor_Logging.cpp. A sample is the rate times
``mul``; the first one of a batch was taken at ``SampleUS``, the others at ``smp_rate`` after it. Rows are
written while later ones are still sampled, so that a batch stands in the file seconds after it was taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, Rows, Signal, whole_number

HEADER, DATA = "ISBH", "ISBD"
MESSAGES: Final = frozenset({HEADER, DATA})
_AXES: Final = ("x", "y", "z")
_HEADER_LABELS: Final = ("N", "type", "instance", "mul", "smp_cnt", "SampleUS", "smp_rate")
LABELS: Final = frozenset({*_HEADER_LABELS, "seqno", *_AXES})
_IS_GYRO: Final = 1
_PER_ROW: Final = 32
#: INS_LOG_BAT_OPT.
_SENSOR_RATE, _AFTER_FILTER, _BOTH = 1, 2, 4
#: Of each gyro that the vehicle has, a parameter that is not 0.
_GYRO_IDS: Final = ("INS_GYR_ID", "INS_GYR2_ID", "INS_GYR3_ID", "INS_GYR4_ID", "INS_GYR5_ID")
#: Sensors give 1 to 32 kHz; what says otherwise is damaged [Hz].
_RATES_HZ: Final = (100.0, 40_000.0)


def gyro_batches(
    tables: Mapping[str, MessageTable], parameters: Mapping[str, float], known: GyroFilter
) -> tuple[Signal, ...]:
    """Return the samples of each gyro, before the filters or behind them.

    Parameters
    ----------
    known : GyroFilter
        What the parameters say of the filters.

    Returns
    -------
    tuple of Signal
        The first gyro's first. Rows whose header is lost or damaged are left out.
    """
    header, data = tables.get(HEADER), tables.get(DATA)
    if (
        header is None
        or data is None
        or not (
            header.n_rows > 0
            and header.has_numbers(*_HEADER_LABELS)
            and data.has_numbers("N", "seqno")
            and data.has(*_AXES)
            and all(data.columns[axis].shape == (data.n_rows, _PER_ROW) for axis in _AXES)
        )
    ):
        return ()
    of_batch = np.searchsorted(header.position, data.position) - 1
    inside: BoolArray = of_batch >= 0
    number, sequence = data.integers("N"), data.integers("seqno")
    inside &= header.integers("N")[of_batch] == number
    inside &= (sequence >= 0) & (sequence * _PER_ROW < header.integers("smp_cnt")[of_batch])
    rate_hz, scale = (header.columns[label].astype(np.float64) for label in ("smp_rate", "mul"))
    sound = (rate_hz >= _RATES_HZ[0]) & (rate_hz <= _RATES_HZ[1]) & (scale > 0.0)
    inside &= (sound & (header.integers("type") == _IS_GYRO))[of_batch]
    kept = np.flatnonzero(inside)
    if not kept.size:
        return ()
    batch, place = of_batch[kept], sequence[kept, np.newaxis] * _PER_ROW + np.arange(_PER_ROW)
    start_s = header.columns["SampleUS"].astype(np.float64)[batch] / 1e6
    time_s = start_s[:, np.newaxis] + place / rate_hz[batch][:, np.newaxis]
    values = np.stack([data.columns[axis][kept].astype(np.float64) for axis in _AXES], axis=-1)
    values /= scale[batch][:, np.newaxis, np.newaxis]
    position = np.repeat(data.position[kept], _PER_ROW).reshape(-1, _PER_ROW)
    instance = header.integers("instance")[batch]
    n_gyros = max(1, sum(bool(parameters.get(name)) for name in _GYRO_IDS))
    option = whole_number(parameters.get("INS_LOG_BAT_OPT"))
    both = bool(option & _BOTH) or option & (_SENSOR_RATE | _AFTER_FILTER) == _SENSOR_RATE | _AFTER_FILTER
    found = []
    for sensor in np.unique(instance).tolist():
        mine = instance == sensor
        filtered = sensor >= n_gyros if both else bool(option & _AFTER_FILTER)
        where = "behind its filters" if filtered else "before its filters"
        found.append(
            Signal(
                name="gyro_samples",
                rows=Rows(time_s[mine].ravel(), position[mine].ravel()),
                values=values[mine].reshape(-1, len(_AXES)),
                source=f"{HEADER} {DATA}[{sensor}]",
                reason=f"batches of gyro {sensor % n_gyros}, {where}",
                gyro_filter=known if filtered else NO_GYRO_FILTER,
                raw=not filtered,
            )
        )
    return tuple(found)
