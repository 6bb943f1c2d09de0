"""Small logs made by hand for the tests of align."""

from __future__ import annotations

import numpy as np

from quadid_logs.align import assemble, clean, cut
from quadid_logs.align.series import TorqueSeries
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings


def align(log: FlightLog, settings: AlignSettings) -> FlightData:
    """Put a log on one clock and cut it, with the torque as logged."""
    cleaned = clean(log)
    torques = [
        TorqueSeries(series=one)
        for name in ("torque_command", "torque_n_m")
        for one in cleaned.candidates.get(name, ())
    ]
    return cut(assemble(log, cleaned, torques), settings)


def signal(name: str, time_s: np.ndarray, values: np.ndarray, *, source: str = "", start: int = 0) -> Signal:
    """Return a signal whose rows follow each other in the file, 50 bytes apart."""
    return Signal(
        name=name,
        rows=Rows(np.asarray(time_s, dtype=float), start + 50 * np.arange(len(time_s), dtype=np.int64)),
        values=np.asarray(values, dtype=float),
        source=source or name,
    )


def flight_log(*signals: Signal, **changes: object) -> FlightLog:
    """Return a multirotor's log of the given signals; several of one name are candidates."""
    by_name: dict[str, tuple[Signal, ...]] = {}
    for each in signals:
        by_name[each.name] = (*by_name.get(each.name, ()), each)
    fields: dict[str, object] = {
        "path": "flight.bin",
        "format": "dataflash",
        "autopilot": "ardupilot",
        "n_bytes": 1000,
        "vehicle_type": "multirotor",
        "signals": by_name,
    }
    return FlightLog(**{**fields, **changes})  # type: ignore[arg-type]


def motion(time_s: np.ndarray, n_columns: int = 3) -> np.ndarray:
    """Return smooth values that never stand still; shape (n_samples, n_columns)."""
    return np.sin(np.asarray(time_s)[:, np.newaxis] * (1.0 + np.arange(n_columns)))


def flown(time_s: np.ndarray, **changes: object) -> FlightLog:
    """Return a log of rates and torque at the given times, in the air all the time."""
    return flight_log(
        signal("body_rate", time_s, motion(time_s)),
        signal("torque_command", time_s, 0.1 * motion(time_s)),
        signal("throttle", time_s, np.full((len(time_s), 1), 0.4)),
        **changes,
    )
