"""Logs to measure on: flown by firmware where the corpus is, and generated ones of any size."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.simulator import simulate
from quadid_logs.writers import write_log

HERE = Path(__file__).resolve().parent
CACHE = HERE / ".cache"
#: Flown by the firmware of ArduPilot, PX4 and Betaflight in the loop.
CORPUS_LOGS = (
    "firmware/ac47_quadx_multisine.BIN",
    "firmware/ac47_quadx_multisine.tlog",
    "firmware/px4_quad_multisine.ulg",
    "firmware/bf_quad_sticks.bbl",
)
#: Rate [Hz], columns, source of what an autopilot logs for system identification.
SERIES = {
    "body_rate_setpoint": (400.0, 3, "RATE.RDes,PDes,YDes"),
    "attitude": (400.0, 3, "ANG.Roll,Pitch,Yaw"),
    "torque_command": (400.0, 3, "RATE.ROut,POut,YOut"),
    "throttle": (400.0, 1, "RATE.AOut"),
    "motor_thrust": (400.0, 4, "actuator_motors.control"),
    "output_pwm": (50.0, 4, "RCOU.C1-C4"),
    "specific_force": (400.0, 3, "IMU[0].AccX,AccY,AccZ"),
    "battery_voltage": (10.0, 1, "BAT.Volt"),
    "battery_ratio": (10.0, 1, "MOTB.BatVolt"),
    "lift_max": (10.0, 1, "MOTB.LiftMax"),
}


def corpus_folder() -> Path:
    """Return where the corpus is, if it is there."""
    return Path(os.environ.get("QUADID_LOG_CORPUS", HERE.parents[1] / "shared" / "logs"))


def corpus_logs() -> list[Path]:
    """Return the firmware logs that are there."""
    folder = corpus_folder()
    return [folder / name for name in CORPUS_LOGS if (folder / name).is_file()]


def generated_log(suffix: str, size_mb: float) -> Path:
    """Return a generated log of about that size, written once and kept in `CACHE`."""
    path = CACHE / f"generated-{size_mb:g}MB{suffix}"
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        probe = CACHE / f"probe{suffix}"
        make = _frames if suffix == ".bbl" else _flight
        write_log(make(10.0), probe)
        write_log(make(10.0 * size_mb * 1e6 / probe.stat().st_size), path)
        probe.unlink()
    return path


def simulated_flight(scenario: str) -> Path:
    """Return the log of a simulated flight, flown once and kept in `CACHE`."""
    path = CACHE / f"{scenario}.bin"
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        write_log(simulate(scenario, seed=1).log, path)
    return path


def many_flights(suffix: str, size_mb: float) -> Path:
    """Return a log of about that size, of short flights; written once and kept in `CACHE`."""
    path = CACHE / f"flights-{size_mb:g}MB{suffix}"
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        autopilot = "betaflight" if suffix == ".bbl" else "ardupilot"
        log = simulate(
            "two-flights", seed=1, rate_hz=1000.0 if suffix == ".bbl" else None, autopilot=autopilot
        ).log
        write_log(_repeated(log, 2), path)
        n_times = max(round(2.0 * size_mb * 1e6 / path.stat().st_size), 1)
        write_log(_repeated(log, n_times), path)
    return path


def _repeated(log: FlightLog, n_times: int) -> FlightLog:
    """Return the same flights again and again, ten seconds apart."""
    every = [one.rows for signals in log.signals.values() for one in signals]
    span_s = max(rows.time_s[-1] for rows in every) - min(rows.time_s[0] for rows in every) + 10.0
    n_bytes = max(int(rows.position[-1]) for rows in every) + 1
    later = {
        id(rows): Rows(
            np.concatenate([rows.time_s + number * span_s for number in range(n_times)]),
            np.concatenate([rows.position + number * n_bytes for number in range(n_times)]),
        )
        for rows in every
    }
    signals = {
        name: tuple(
            replace(one, rows=later[id(one.rows)], values=np.tile(one.values, (n_times, 1))) for one in found
        )
        for name, found in log.signals.items()
    }
    return replace(log, signals=signals)


def _flight(duration_s: float) -> FlightLog:
    """Return smooth series at the autopilot's rates; the values do not matter for reading."""
    signals = {name: (_signal(name, duration_s, *specification),) for name, specification in SERIES.items()}
    signals["body_rate"] = (
        _signal("body_rate", duration_s, 400.0, 3, "RATE.R,P,Y"),
        _signal("body_rate", duration_s, 400.0, 3, "IMU[0].GyrX,GyrY,GyrZ"),
    )
    return FlightLog(path="", format="dataflash", autopilot="ardupilot", n_bytes=0, signals=signals)


def _frames(duration_s: float) -> FlightLog:
    """Return the same as one frame a row, which holds all signals that are logged at the rate of the gyro."""
    flight = _flight(duration_s)
    rows = flight.candidates("body_rate")[0].rows
    signals = {
        name: tuple(replace(signal, rows=rows) for signal in found if len(signal.values) == len(rows.time_s))
        for name, found in flight.signals.items()
    }
    limits = {"motorOutput[0]": 48.0, "motorOutput[1]": 2047.0}
    return replace(
        flight, signals={name: found for name, found in signals.items() if found}, parameters=limits
    )


def _signal(name: str, duration_s: float, rate_hz: float, n_columns: int, source: str) -> Signal:
    """Return one series of sines."""
    row = np.arange(int(duration_s * rate_hz))
    values = 0.5 + 0.4 * np.sin(row[:, np.newaxis] / rate_hz + np.arange(n_columns))
    return Signal(name=name, rows=Rows(10.0 + row / rate_hz, row), values=values, source=source)
