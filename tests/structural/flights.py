"""Rigid bodies under a rate loop with effects that no rigid body has; independent of the package's simulator.

All flights are integrated side by side, one column of each array per flight.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.vocabulary import MULTIROTOR

_STEP_S = 1.0 / 800.0
#: Of one motor each: roll, pitch, yaw.
_MIXER = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]])
DURATION_S = 36.0
#: On-axis effectiveness of the vehicle of all flights [rad/s^2].
GAIN = np.array([220.0, 180.0, 24.0])


@dataclass(frozen=True, kw_only=True)
class Effects:
    """What a flight has that the model does not."""

    manoeuvre: str = "multisine"
    dead_zone: float = 0.0
    """Torque below which there is none."""
    limit: float = 0.0
    """Torque above which there is no more, 0 for none."""
    mode_hz: float = 0.0
    """Of an arm that bends and carries the gyro."""
    tilt_1_s2: float = 0.0
    """Angular acceleration per angle: positive tips over, negative is a pendulum."""
    sling_1_s2: float = 0.0
    """Angular acceleration per angle to a load on a string of a metre, 15 % of the mass."""
    alternating: float = 0.0
    """Fraction by which the gain is higher and lower, in turn, for 2.5 s."""
    up_s: float = 0.0
    down_s: float = 0.0
    """Lags of rotors that spin up and down, 0 for the vehicle's one lag on the torque."""
    gain: float = 1.0
    """Of this vehicle over the others'."""
    gust_rad_s2: float = 0.1


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A logged flight: each (n_samples, 3), ``gain`` (3,) the true on-axis effectiveness."""

    time_s: np.ndarray
    rate: np.ndarray
    setpoint: np.ndarray
    torque: np.ndarray
    attitude: np.ndarray
    gain: np.ndarray

    def late(self, late_s: float) -> Flight:
        """Return the flight with its torque stamped late."""
        columns = [np.interp(self.time_s - late_s, self.time_s, column) for column in self.torque.T]
        return replace(self, torque=np.column_stack(columns))

    def log(self, *, setpoints: bool = True, attitude: bool = True, **more: np.ndarray) -> FlightLog:
        """Return what a reader of a table makes of it."""
        columns = {"body_rate": self.rate, "torque_command": self.torque}
        columns |= {"body_rate_setpoint": self.setpoint} if setpoints else {}
        columns |= {"attitude": self.attitude} if attitude else {}
        rows = Rows(self.time_s, np.arange(self.time_s.size, dtype=np.int64))
        return FlightLog(
            path="table.csv",
            format="table",
            autopilot="other",
            n_bytes=1,
            vehicle_type=MULTIROTOR,
            signals={
                name: (Signal(name=name, rows=rows, values=values, source="CSV", reason="its name"),)
                for name, values in (columns | more).items()
            },
        )


def fly(flights: list[Effects], *, seed: int = 0) -> list[Flight]:
    """Integrate all flights by Euler's method at 800 Hz and log them at 200 Hz."""
    rng = np.random.default_rng(seed)
    n, time_s = len(flights), np.arange(0.0, DURATION_S, _STEP_S)
    has = {each.name: np.array([[getattr(one, each.name)] for one in flights]) for each in fields(Effects)}
    wanted = np.stack([_manoeuvre(one.manoeuvre, time_s, rng) for one in flights], axis=1)
    true_gain, damping, gyroscopic = GAIN, np.array([1.2, 0.9, 0.3]), np.array([-0.6, 0.6, 0.0])
    lag_s, behind = 0.03, 4
    decay, fade = np.exp(-_STEP_S / lag_s), np.exp(-_STEP_S / 0.5)
    proportional = 0.3 / (lag_s + _STEP_S * behind) * np.array([1.0, 1.0, 0.5])
    limit = np.where(has["limit"] > 0.0, has["limit"], np.inf) * np.array([1.0, 1.0, np.inf])
    omega, bends = 2.0 * np.pi * has["mode_hz"], 0.4 * (has["mode_hz"] > 0.0)
    by_rotors = has["up_s"] > 0.0
    up, down = (-np.expm1(-_STEP_S / np.maximum(has[name], 1e-3)) for name in ("up_s", "down_s"))
    gains = [has["gain"] * (1.0 + sign * has["alternating"]) for sign in (1.0, -1.0)]
    gust_step = has["gust_rad_s2"] * np.array([1.0, 1.0, 0.3]) * np.sqrt(1.0 - fade**2)
    rate, angle, torque, total, gust, seen, bent, bend_rate = (np.zeros((n, 3)) for _ in range(8))
    swing, swing_rate = np.zeros((n, 2)), np.zeros((n, 2))
    thrust, command = np.zeros((n, 4)), np.zeros((n, 3))
    sent = np.zeros((8, n, 3))
    logged: dict[str, list[np.ndarray]] = {name: [] for name in ("rate", "setpoint", "torque", "attitude")}
    products = np.empty((n, 3))
    for k, (now_s, (noise, air)) in enumerate(
        zip(time_s, rng.standard_normal((time_s.size, 2, n, 3)), strict=True)
    ):
        seen = seen + 0.5 * (rate + bend_rate + 0.004 * noise - seen)
        if k % 2 == 0:
            setpoint = wanted[k] - angle * np.array([2.0, 2.0, 0.0])
            total = total + 1.2 * proportional * (setpoint - seen) * 2.0 * _STEP_S
            command = (proportional * (setpoint - seen) + total) / true_gain
        if k % 4 == 0:
            for name, values in zip(logged, (seen, setpoint, command, angle), strict=True):
                logged[name].append(values)
        sent[k % 8] = command
        given = sent[(k - behind) % 8]
        given = np.sign(given) * np.maximum(np.abs(given) - has["dead_zone"], 0.0)
        given = np.minimum(np.maximum(given, -limit), limit)
        torque = given + (torque - given) * decay
        if by_rotors.any():
            lacking = given @ _MIXER.T - thrust
            thrust = thrust + lacking * np.where(lacking > 0.0, up, down)
            torque = np.where(by_rotors, thrust @ _MIXER / 4.0, torque)
        gust = fade * gust + gust_step * air
        gain = gains[0] if now_s % 5.0 < 2.5 else gains[1]
        p, q, r = rate.T
        acceleration = gain * true_gain * torque - damping * rate + gust
        products[:, 0], products[:, 1], products[:, 2] = q * r, p * r, p * q
        acceleration += gyroscopic * products
        acceleration[:, :2] += has["tilt_1_s2"] * angle[:, :2]
        if has["sling_1_s2"].any():
            # The load falls back below the hook, which goes where thrust is tilted to and the string pulls.
            swing_rate = swing_rate - _STEP_S * (9.81 * (1.15 * swing + angle[:, :2]) + 0.3 * swing_rate)
            swing = swing + _STEP_S * swing_rate
            acceleration[:, :2] -= has["sling_1_s2"] * (angle[:, :2] + swing)
        if bends.any():
            pulled = bends * acceleration - 0.1 * omega * bend_rate - omega**2 * bent
            bend_rate = bend_rate + _STEP_S * pulled
            bent = bent + _STEP_S * bend_rate
        rate = rate + _STEP_S * acceleration
        angle = angle + _STEP_S * _angle_rate(angle, rate)
    series = {name: np.array(values) for name, values in logged.items()}
    return [
        Flight(
            time_s=time_s[::4],
            gain=has["gain"][number] * GAIN,
            **{name: values[:, number] for name, values in series.items()},
        )
        for number in range(n)
    ]


def _angle_rate(angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    phi, theta, _ = angle.T
    p, q, r = rate.T
    sine, cosine = np.sin(phi), np.cos(phi)
    turn = sine * q + cosine * r
    turned = np.empty(angle.shape)
    turned[:, 0], turned[:, 1], turned[:, 2] = (
        p + turn * np.tan(theta),
        cosine * q - sine * r,
        turn / np.cos(theta),
    )
    return turned


def _manoeuvre(name: str, time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return rates to be flown [rad/s]; shape (n_times, 3)."""
    wanted = np.zeros((time_s.size, 3))
    if name == "tone":
        lines, size = rng.uniform(3.6, 4.4, (1, 3)), 0.8
    else:
        lines, size = 0.6 * np.arange(7)[:, None] + rng.uniform(0.3, 0.6, (7, 3)), 0.5
    if "doublets" not in name:
        for line in lines:
            wanted += np.sin(2.0 * np.pi * line * time_s[:, None] + rng.uniform(0.0, 6.3, 3))
        return size * wanted
    pause_s = (3.0, 5.0) if name == "rare doublets" else (0.3, 1.5)
    for axis in range(3):
        at_s = 1.0
        while at_s < time_s[-1] - 2.0:
            half_s, size = rng.uniform(0.12, 0.45), rng.choice([-1.0, 1.0])
            wanted[(time_s >= at_s) & (time_s < at_s + half_s), axis] += size
            wanted[(time_s >= at_s + half_s) & (time_s < at_s + 2.0 * half_s), axis] -= size
            at_s += 2.0 * half_s + rng.uniform(*pause_s)
    return wanted
