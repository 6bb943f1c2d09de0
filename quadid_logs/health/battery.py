"""The battery under load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.data.health import Battery, Level, Quantity
from quadid_logs.health.records import Record, averaged, in_flight
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.numerals import plus_minus

#: For a cell, where an autopilot's defaults warn and where they land (sources: docs/health.md) [V].
_WARN_V, _LAND_V = 3.5, 3.3
#: Between these a lithium-polymer cell starts a flight: nearly empty, and full at high voltage [V].
_CELL_V: Final = (3.55, 4.35)
#: As batteries are sold.
_CELLS: Final = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14)
#: Below, nothing was measured [V].
_LEAST_V: Final = 2.5
#: A battery that carries a vehicle falls by more than the last digit that is shown [V].
_FALLS_V: Final = 0.1
_MEAN_S: Final = 1.0
_FEWEST: Final = 20
#: Throttle and voltage are compared within blocks of this length [s].
_BLOCK_S: Final = 5.0
_TENTH: Final = 0.1


def find_battery(
    voltage: CleanSeries, throttle: CleanSeries | None, intervals: Sequence[Interval], n_stated: int = 0
) -> Battery | None:
    """Say how far the voltage falls.

    Parameters
    ----------
    intervals : sequence of (start_s, end_s)
        Of flight.
    n_stated : int
        How many cells the parameters state, 0 for none. It counts where the voltage does not show another
        number: a default need not be that of the battery.

    Returns
    -------
    Battery or None
        None where no voltage was measured in flight.
    """
    record = in_flight(voltage, intervals)
    record = Record(record.time_s, record.values[:, :1])
    if record.time_s.size < _FEWEST or not np.median(record.values) > _LEAST_V:
        return None
    if not np.ptp(record.values) > 0.0:  # a sensor that is not there
        return None
    # The time that the samples cover, without pauses [s].
    steps = np.diff(record.time_s)
    flown_s = float(steps[steps <= 5.0 * np.median(steps)].sum())
    n_mean = max(1, round(_MEAN_S * record.time_s.size / max(flown_s, _MEAN_S)))
    n_means = record.time_s.size // n_mean
    means = record.values[: n_means * n_mean, 0].reshape(n_means, n_mean).mean(axis=1)
    start, lowest = float(means[0]), float(means.min())
    # The number of cells, 0 where more than one number fits.
    highest_v = float(means.max())
    fitting = [n for n in _CELLS if _CELL_V[0] <= highest_v / n <= _CELL_V[1]]
    # A nearly empty battery fits none, and one of many cells several.
    possible = n_stated > 0 and _LEAST_V <= highest_v / n_stated <= _CELL_V[1]
    if n_stated in fitting or (possible and not fitting):
        fitting = [n_stated]
    sag = None if throttle is None else _sag(record, throttle)
    # What neither falls nor sags, at a voltage of no battery, is an input that was left open.
    if sag is None and start - lowest < _FALLS_V and not fitting:
        return None
    if highest_v <= _CELL_V[1]:  # nearly empty or not: two cells have more
        fitting = [1]
    n_cells = fitting[0] if len(fitting) == 1 else 0
    level: Level = "fact"
    if n_cells:
        per_cell = lowest / n_cells
        level = "normal" if per_cell >= _WARN_V else "high" if per_cell >= _LAND_V else "severe"
    short = averaged(record)
    told = f"The battery falls from {start:.1f} to {lowest:.1f} V under load"
    if f"{start:.1f}" == f"{lowest:.1f}":
        told = f"The battery stays at {start:.1f} V"
    if n_cells:
        per_cell = lowest / n_cells
        judged = {
            "normal": "which is normal (3.5 V or more)",
            "high": "below 3.5 V, at which pilots should land",
            "severe": "below 3.3 V, at which pilots must land at once",
        }[level]
        each = f"each of {n_cells} cells" if n_cells > 1 else "its one cell"
        told += f": {per_cell:.2f} V for {each}, {judged}"
    if sag is None or sag.ci95 is None:
        told = f"{told}."
    else:
        half = 0.5 * (sag.ci95[1] - sag.ci95[0])
        told = f"{told}. It sags by {plus_minus(sag.value, half)} V for each 10 % of throttle."
    return Battery(
        sentence=told,
        level=level,
        start_v=Quantity(start, "V"),
        lowest_v=Quantity(lowest, "V", normal=(_WARN_V * n_cells, _CELL_V[1] * n_cells) if n_cells else None),
        n_cells=n_cells,
        sag_v=sag,
        time_s=short.time_s,
        voltage=short.values[:, 0],
    )


def _sag(record: Record, throttle: CleanSeries) -> Quantity | None:
    """Return the drop for each tenth of the throttle beside the discharge [V], None where it is not seen.

    Compared within blocks of some seconds: over a whole flight, throttle rises because the voltage falls.
    """
    level = throttle.at(record.time_s)
    good = np.isfinite(level)
    if np.count_nonzero(good) < _FEWEST or not np.std(level[good]) > 0.0:
        return None
    time_s, volts, level = record.time_s[good], record.values[good, 0], level[good]
    starts = np.flatnonzero(np.diff(np.floor(time_s / _BLOCK_S), prepend=-np.inf))
    counts = np.diff(np.append(starts, time_s.size))
    volts, level = (one - np.repeat(np.add.reduceat(one, starts) / counts, counts) for one in (volts, level))
    power = float(np.sum(level**2))
    if not power > 0.0:
        return None
    slope = float(np.sum(level * volts)) / power
    left = volts - slope * level
    # Neighbouring residuals are alike: as many count as their correlation leaves.
    alike = float(np.clip(np.corrcoef(left[1:], left[:-1])[0, 1], 0.0, 0.999)) if left.std() > 0.0 else 0.0
    counted = max(level.size * (1.0 - alike) / (1.0 + alike), 4.0)
    error = _TENTH * float(np.sqrt(left.var() * level.size / counted / power))
    drop = -_TENTH * slope
    if not drop > NORMAL_95 * error:
        return None
    return Quantity(drop, "V", (drop - NORMAL_95 * error, drop + NORMAL_95 * error))
