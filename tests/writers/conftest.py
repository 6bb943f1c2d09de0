"""A small flight built by hand, and the same one as each format's file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog, LogText, ModeChange, Rows, Signal
from quadid_logs.writers import write_log

START_S = 12.5
DURATION_S = 3.0

#: Rate [Hz], columns, source: as an autopilot would log them.
SERIES = {
    "body_rate_setpoint": (400.0, 3, "RATE.RDes,PDes,YDes"),
    "attitude": (400.0, 3, "ANG.Roll,Pitch,Yaw"),
    "torque_command": (400.0, 3, "RATE.ROut,POut,YOut"),
    "throttle": (400.0, 1, "RATE.AOut"),
    "motor_thrust": (100.0, 4, "actuator_motors.control"),
    "output_pwm": (10.0, 4, "RCOU.C1-C4"),
    "rotor_speed": (50.0, 4, "ESC.RPM"),
    "specific_force": (400.0, 3, "IMU[0].AccX,AccY,AccZ"),
    "battery_voltage": (10.0, 1, "BAT.Volt"),
    "battery_ratio": (10.0, 1, "MOTB.BatVolt"),
    "lift_max": (10.0, 1, "MOTB.LiftMax"),
    "unallocated_torque": (5.0, 3, "control_allocator_status.unallocated_torque"),
    "sysid_chirp": (100.0, 1, "SIDD.Targ"),
}
SCALE = {"output_pwm": (1000.0, 900.0), "rotor_speed": (300.0, 600.0), "battery_voltage": (11.0, 1.6)}


def series(name: str, *, rate_hz: float, n_columns: int, source: str, start_s: float = START_S) -> Signal:
    """Return a signal of smooth values that differ in every row and column."""
    n = int(DURATION_S * rate_hz)
    time_s = start_s + np.arange(n) / rate_hz
    phase = np.arange(n)[:, np.newaxis] / rate_hz + np.arange(n_columns) + len(name)
    low, span = SCALE.get(name, (-0.5, 1.0))
    values = low + span * (0.5 + 0.5 * np.sin(phase))
    return Signal(name=name, rows=Rows(time_s, np.arange(n, dtype=np.int64)), values=values, source=source)


def switch(name: str, times_s: list[float], states: list[float]) -> Signal:
    """Return a two-valued signal with a row per change."""
    return Signal(
        name=name,
        rows=Rows(np.array(times_s), np.arange(len(states), dtype=np.int64)),
        values=np.array(states)[:, np.newaxis],
        source=name,
    )


def flight(**changes: object) -> FlightLog:
    """Return a short flight with every series that an autopilot logs."""
    signals = {
        name: (series(name, rate_hz=rate, n_columns=columns, source=source),)
        for name, (rate, columns, source) in SERIES.items()
    }
    signals["body_rate"] = (
        series("body_rate", rate_hz=400.0, n_columns=3, source="RATE.R,P,Y"),
        series("body_rate", rate_hz=400.0, n_columns=3, source="IMU[0].GyrX,GyrY,GyrZ", start_s=START_S),
    )
    signals["armed"] = (switch("armed", [START_S, START_S + 0.5, START_S + 2.75], [0.0, 1.0, 0.0]),)
    signals["landed"] = (switch("landed", [START_S, START_S + 0.75, START_S + 2.5], [1.0, 0.0, 1.0]),)
    settings: dict[str, object] = {
        "path": "by hand",
        "format": "dataflash",
        "autopilot": "ardupilot",
        "n_bytes": 0,
        "signals": signals,
        "firmware": "ArduCopter V4.6.1 (abcdef01)",
        "vehicle_type": "multirotor",
        "frame": "QUAD/X",
        "parameters": {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, "MOT_THST_EXPO": 0.65, "INS_GYRO_FILTER": 20.0},
        "modes": (
            ModeChange(time_s=START_S, position=0, name="STABILIZE"),
            ModeChange(time_s=START_S + 1.0, position=1, name="ALT_HOLD"),
        ),
        "texts": (LogText(time_s=START_S + 0.5, position=0, text="Arming motors: élan"),),
    }
    return FlightLog(**(settings | changes))  # type: ignore[arg-type]


def px4_flight(**changes: object) -> FlightLog:
    """Return the same flight as PX4 would have flown it."""
    parameters = {"CA_ROTOR_COUNT": 4.0, "CA_ROTOR0_PX": 1.0, "MC_BAT_SCALE_EN": 0.0, "SYS_AUTOSTART": -1.0}
    return flight(autopilot="px4", format="ulog", firmware="PX4 v1.17.2", parameters=parameters, **changes)


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a log under a name and returns its path."""

    def write(log: FlightLog, name: str) -> Path:
        path = tmp_path / name
        write_log(log, path)
        return path

    return write


def float32(values: FloatArray) -> FloatArray:
    """Round as a 4-byte field does."""
    return values.astype(np.float32).astype(np.float64)


def twice(log: FlightLog) -> FlightLog:
    """Append the same flight again after a reboot: its clock starts anew, its place in the log does not."""
    n_bytes = 10_000

    def again(signal: Signal) -> Signal:
        return Signal(
            name=signal.name,
            rows=Rows(
                np.tile(signal.time_s, 2), np.concatenate((signal.position, signal.position + n_bytes))
            ),
            values=np.tile(signal.values, (2, 1)),
            source=signal.source,
        )

    return replace(
        log,
        signals={name: tuple(map(again, signals)) for name, signals in log.signals.items()},
        modes=log.modes + tuple(replace(mode, position=mode.position + n_bytes) for mode in log.modes),
        texts=log.texts + tuple(replace(text, position=text.position + n_bytes) for text in log.texts),
    )
