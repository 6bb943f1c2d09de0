"""Logs of controllers that ran on given set-points and rates, loop by loop, independent of the package."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import signal

from quadid_logs.data.log import ControllerTerms, FlightLog, ParameterChange, Rows, Signal

AP_NAMES = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}
PX4_NAMES = {"roll": "ROLL", "pitch": "PITCH", "yaw": "YAW"}
AP_PID = {
    "P": 0.135,
    "I": 0.2,
    "D": 0.0036,
    "FF": 0.0,
    "D_FF": 0.0,
    "IMAX": 0.5,
    "FLTT": 20.0,
    "FLTE": 0.0,
    "FLTD": 20.0,
    "PDMX": 0.0,
}
AP_YAW = AP_PID | {"P": 0.3, "I": 0.02, "D": 0.0, "FLTE": 2.5}
PX4_PID = {"P": 0.15, "I": 0.05, "D": 0.003, "FF": 0.0, "K": 1.0}


def motion(n: int, seed: int, cutoff_hz: float = 8.0, rate_hz: float = 400.0) -> np.ndarray:
    """Return three axes of broadband motion of about 1 rad/s; shape (n, 3)."""
    b, a = signal.butter(2, cutoff_hz, fs=rate_hz)
    noise = np.random.default_rng(seed).standard_normal((n + 400, 3))
    found = signal.lfilter(b, a, noise, axis=0)[400:]
    return found / found.std(axis=0)


def alpha(dt: float, cutoff_hz: float) -> float:
    return 1.0 if cutoff_hz <= 0 else dt / (dt + 1.0 / (2.0 * np.pi * cutoff_hz))


def ap_pid(target, rate, dt, limit, p, scale=None, notch=None):
    """AC_PID by its published recurrences, in plain Python; returns P, I, D, FF."""
    n = len(target)
    # Plain floats cost a tenth of numpy's.
    target, rate, dt, limit = (each.tolist() for each in (target, rate, dt, limit))
    notch = None if notch is None else notch.tolist()
    t_, e_, d_, i_, td = ([0.0] * n for _ in range(5))
    error = lambda k: notch[k] if notch is not None else t_[k] - rate[k]  # noqa: E731
    t_[0] = target[0]
    e_[0] = error(0)
    for k in range(1, n):
        h = dt[k]
        t_[k] = t_[k - 1] + alpha(h, p["FLTT"]) * (target[k] - t_[k - 1])
        e_[k] = e_[k - 1] + alpha(h, p["FLTE"]) * (error(k) - e_[k - 1])
        d_[k] = d_[k - 1] + alpha(h, p["FLTD"]) * ((e_[k] - e_[k - 1]) / h - d_[k - 1])
        td[k] = (t_[k] - t_[k - 1]) / h
        ok = not limit[k] or i_[k - 1] * e_[k] < 0
        i_[k] = min(max(i_[k - 1] + (e_[k] * p["I"] * h if ok else 0.0), -p["IMAX"]), p["IMAX"])
    t_, e_, d_, i_, td = map(np.array, (t_, e_, d_, i_, td))
    proportional, derivative = p["P"] * e_, p["D"] * d_
    if scale is not None:
        proportional, derivative = scale * proportional, scale * derivative
    if p["PDMX"] > 0:
        size = np.abs(proportional + derivative)
        factor = np.where(size > p["PDMX"], p["PDMX"] / np.maximum(size, 1e-12), 1.0)
        proportional, derivative = factor * proportional, factor * derivative
    return proportional, i_, derivative, p["FF"] * t_ + p["D_FF"] * td


@dataclass
class ApFlight:
    """What flew; the log is made of it."""

    n: int = 8000
    seed: int = 1
    pids: dict = field(default_factory=lambda: {"roll": AP_PID, "pitch": AP_PID, "yaw": AP_YAW})
    limited_fraction: float = 0.05
    scale: np.ndarray | None = None
    notch_hz: float = 0.0
    change_at: int = 0
    changed: dict = field(default_factory=dict)

    def log(
        self, *, terms: bool = True, parameters: dict | None = None, version: str = "V4.7.0"
    ) -> FlightLog:
        """Return a log as ArduPilot writes it: the set-point of a row is that of the next loop."""
        rng = np.random.default_rng(self.seed + 7)
        dt = np.where(rng.random(self.n) < 0.01, 3332e-6, 2499e-6)
        time_s = np.round(50.0 + np.cumsum(dt), 6)
        dt = np.diff(time_s, prepend=time_s[0] - 2499e-6)
        target, rate = motion(self.n, self.seed, 3.0), motion(self.n, self.seed + 1)
        limited = rng.random((self.n, 3)) < self.limited_fraction
        rows = Rows(time_s, np.arange(self.n, dtype=np.int64) * 100)
        output, logged = np.zeros((self.n, 3)), []
        for number, axis in enumerate(AP_NAMES):
            found = self._terms(axis, target[:, number], rate[:, number], dt, limited[:, number])
            output[:, number] = sum(found)
            values = dict(zip(["P", "I", "D", "FF"], found, strict=True)) | {
                "limited": limited[:, number] * 1.0
            }
            if self.scale is not None:
                values["scale"] = self.scale
            logged.append(ControllerTerms(axis=axis, rows=rows, values=values))
        row_target = np.vstack([target[1:], target[-1:]])
        return FlightLog(
            path="flight.bin", format="dataflash", autopilot="ardupilot", n_bytes=1,
            firmware=f"ArduCopter {version}",
            signals={
                name: (Signal(name=name, rows=rows, values=values, source="RATE"),)
                for name, values in (
                    ("body_rate_setpoint", row_target), ("body_rate", rate), ("torque_command", output))
            },
            parameters=self.parameters() | (parameters or {}),
            parameter_changes=self.changes(time_s, rows.position),
            controller_terms=tuple(logged) if terms else (),
        )  # fmt: skip

    def _terms(self, axis, target, rate, dt, limited):
        notched = None
        if self.notch_hz:
            pid = self.pids[axis]
            filtered, _, _, _ = ap_pid(
                target, rate * 0, dt, limited, dict(AP_PID, FLTE=0.0, FLTT=pid["FLTT"], P=1.0)
            )
            b, a = signal.iirnotch(self.notch_hz, 1.0, fs=400.0)
            notched = signal.lfilter(b, a, filtered - rate)
        found = ap_pid(target, rate, dt, limited, self.pids[axis], self.scale, notched)
        if not self.change_at:
            return found
        after = ap_pid(target, rate, dt, limited, self.pids[axis] | self.changed, self.scale, notched)
        late = np.arange(self.n) >= self.change_at
        return tuple(np.where(late, b, a) for a, b in zip(found, after, strict=True))

    def parameters(self) -> dict:
        """Return the parameters at the end."""
        found = {"SCHED_LOOP_RATE": 400.0, "INS_GYRO_FILTER": 20.0}
        for axis, name in AP_NAMES.items():
            pid = self.pids[axis] | (self.changed if self.change_at else {})
            found |= {f"ATC_RAT_{name}_{short}": value for short, value in pid.items()}
            found[f"ATC_ANG_{name}_P"] = 4.5
        return found

    def changes(self, time_s, position) -> tuple[ParameterChange, ...]:
        """Return the changes in flight as the log holds them."""
        if not self.change_at:
            return ()
        return tuple(
            ParameterChange(
                time_s=float(time_s[self.change_at]), position=int(position[self.change_at]),
                name=f"ATC_RAT_{name}_{short}", value=value, before=self.pids[axis][short])
            for axis, name in AP_NAMES.items()
            for short, value in self.changed.items()
        )  # fmt: skip


@dataclass
class Px4Flight:
    """What flew; the log is made of it. Set-points of loop k are used in loop k + 1."""

    n: int = 8000
    seed: int = 3
    missing_fraction: float = 0.0
    every: int = 1
    parameters_: dict = field(default_factory=dict)

    def log(self, *, derivative: bool = True, parameters: dict | None = None) -> FlightLog:
        """Return a log as the high-rate profile writes it."""
        rng = np.random.default_rng(self.seed + 7)
        dt = np.where(rng.random(self.n) < 0.02, 4100e-6, 4000e-6)
        time_s = np.round(20.0 + np.cumsum(dt), 6)
        setpoint, rate = motion(self.n, self.seed, 3.0, 250.0), motion(self.n, self.seed + 1, 8.0, 250.0)
        output, slopes = np.zeros((self.n, 3)), np.zeros((self.n, 3))
        for number, axis in enumerate(PX4_NAMES):
            output[:, number], slopes[:, number] = self._torque(
                axis, setpoint[:, number], rate[:, number], time_s
            )
        rows = Rows(time_s, np.arange(self.n, dtype=np.int64) * 100)
        kept = rng.random(self.n) >= self.missing_fraction
        kept &= np.arange(self.n) % self.every == 0
        published = Rows(time_s[kept] + 1e-4, rows.position[kept] + 10)
        terms = tuple(
            ControllerTerms(axis=axis, rows=rows, values={"derivative": slopes[:, number]})
            for number, axis in enumerate(PX4_NAMES)
        )
        return FlightLog(
            path="flight.ulg", format="ulog", autopilot="px4", n_bytes=1, firmware="PX4 v1.18.0",
            signals={
                name: (Signal(name=name, rows=where, values=values, source=name),)
                for name, where, values in (
                    ("body_rate_setpoint", published, setpoint[kept]), ("body_rate", rows, rate),
                    ("torque_command", rows, output))
            },
            parameters=self.parameters() | (parameters or {}),
            controller_terms=terms if derivative else (),
        )  # fmt: skip

    def parameters(self) -> dict:
        """Return the parameters."""
        found = {"IMU_DGYRO_CUTOFF": 20.0, "IMU_GYRO_CUTOFF": 40.0, "MC_YAW_TQ_CUTOFF": 2.0}
        for name in PX4_NAMES.values():
            found |= {f"MC_{name}RATE_{short}": value for short, value in PX4_PID.items()}
        return found | self.parameters_

    def _torque(self, axis, setpoint, rate, time_s):
        p = {short: self.parameters()[f"MC_{PX4_NAMES[axis]}RATE_{short}"] for short in PX4_PID}
        setpoint, rate, time_s = (each.tolist() for each in (setpoint, rate, time_s))
        output, slope = [0.0] * self.n, [0.0] * self.n
        integral = filtered = 0.0
        end = float(np.radians(400.0))
        for k in range(1, self.n):
            dt = time_s[k] - time_s[k - 1]
            slope[k] = slope[k - 1] + alpha(dt, 20.0) * ((rate[k] - rate[k - 1]) / dt - slope[k - 1])
            error = setpoint[k - 1] - rate[k]
            torque = (
                p["K"] * p["P"] * error + integral - p["K"] * p["D"] * slope[k] + p["FF"] * setpoint[k - 1]
            )
            slower = max(0.0, 1.0 - (error / end) ** 2)
            integral = min(max(integral + slower * p["K"] * p["I"] * error * dt, -0.3), 0.3)
            filtered += alpha(dt, 2.0 if axis == "yaw" else 0.0) * (torque - filtered)
            output[k] = filtered
        return np.array(output), np.array(slope)
