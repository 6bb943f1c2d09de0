"""What the gyro's FIFO held, as `sensor_gyro_fifo` logs it: each row up to 32 samples before all filters.

Source: PX4-Autopilot msg/SensorGyroFifo.msg and src/lib/drivers/gyroscope/PX4Gyroscope.cpp (updateFIFO):
counts in board axes FRD, of which ``scale`` makes rad/s; ``timestamp_sample`` is when the FIFO was read, at
its last sample, and ``dt`` the sensor's nominal period.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.sources import Built, Part, Source
from quadid_logs.containers.ulog import TopicTable
from quadid_logs.data.log import Rows

FIELDS: Final = ("x", "y", "z", "dt", "scale", "samples")
_AXES: Final = FIELDS[:3]
_MOST: Final = 32
#: Sensors give 500 Hz to 32 kHz; what says otherwise is damaged [us].
_PERIODS_US: Final = (30.0, 2000.0)
#: A sensor's own clock is right to a few percent; rows that lie further apart are not neighbours.
_SAME_PERIOD: Final = 0.3


def gyro_fifo(part: Part[TopicTable], source: Source[Any]) -> Built | None:
    """Return every sample at its own time; None where there is none.

    Rows with impossible counts, periods or scales are left out.
    """
    columns = [part.table.column(name) for name in source.fields]
    if any(one is None or one.dtype.kind not in "iuf" for one in columns):
        return None
    x, y, z, period_us, scale, count = (np.asarray(one) for one in columns)
    shape = (len(period_us), _MOST)
    if not all(one.shape == shape for one in (x, y, z)) or any(
        one.ndim != 1 for one in (period_us, scale, count)
    ):
        return None
    period_s, factor = period_us.astype(np.float64) / 1e6, scale.astype(np.float64)
    sound = (period_s >= _PERIODS_US[0] / 1e6) & (period_s <= _PERIODS_US[1] / 1e6)
    sound &= np.isfinite(factor) & (factor > 0.0) & (count > 0) & (count <= _MOST)
    sound &= np.isfinite(part.rows.time_s)
    if not sound.any():
        return None
    n_samples, read_s = count[sound].astype(np.int64), part.rows.time_s[sound]
    held: BoolArray = np.arange(_MOST) < n_samples[:, np.newaxis]
    # By when the FIFO was read: the sensor's clock is not the autopilot's.
    step_s = period_s[sound]
    apart_s = np.diff(read_s, prepend=np.nan) / n_samples
    near = np.abs(apart_s / step_s - 1.0) < _SAME_PERIOD
    step_s = np.where(near, apart_s, step_s)
    ahead = n_samples[:, np.newaxis] - 1 - np.arange(_MOST)
    time_s: FloatArray = read_s[:, np.newaxis] - ahead * step_s[:, np.newaxis]
    values = np.column_stack([one[sound][held].astype(np.float64) for one in (x, y, z)])
    values *= np.repeat(factor[sound], n_samples)[:, np.newaxis]
    rows = Rows(time_s[held], np.repeat(part.rows.position[sound], n_samples))
    return Built(values, source=f"{part.name}.{', '.join(_AXES)}", rows=rows)
