"""Flights with known truth, integrated here and not by the package's own simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from quadid_logs.data.flight import FlightData, InputDescription, Segment
from quadid_logs.data.log import GyroFilter
from quadid_logs.maths.band import angular_frequency, butterworth_response
from tests.kept import SHELVES
from tests.kept_stages import content_key

Triple = tuple[float, float, float]
PERIOD_S = 0.0025
_SUBSTEPS = 2


@dataclass(frozen=True, kw_only=True)
class Truth:
    """A rigid body with damping behind a lag and a delay on the torque."""

    inertia: np.ndarray
    damping: np.ndarray
    lag_s: float = 0.03
    delay_s: float = 0.005
    noise_rad_s: float = 0.002
    gyro_filter_hz: float = float("nan")
    quadratic_roll_damping: float = 0.0
    """Of p |p| [1/rad]."""

    @property
    def B(self) -> np.ndarray:
        """Acceleration per torque."""
        return np.linalg.inv(self.inertia)


QUAD = Truth(inertia=np.diag([0.010, 0.012, 0.020]), damping=np.diag([1.5, 1.2, 0.6]))


def multisine(duration_s: float, axes: tuple[int, ...] = (0, 1, 2), size: float = 0.15) -> np.ndarray:
    """Return torques that move all axes at different frequencies; shape (n_samples, 3)."""
    t = np.arange(0.0, duration_s, PERIOD_S)
    torque = np.zeros((t.size, 3))
    for axis in axes:
        for k in range(6):
            frequency = 0.35 + 0.55 * k + 0.13 * axis
            torque[:, axis] += np.sin(2 * np.pi * frequency * t + 1.7 * k * k + axis)
    return size * torque * np.diag(QUAD.inertia) / 0.014


def fly(truth: Truth, excitation: np.ndarray, *, seed: int = 0, feedback: float = 0.0) -> FlightData:
    """Integrate J w_dot = u - w x J w - J D w and log it at 400 Hz with noise, once for all test processes.

    ``feedback`` [1/s] adds a rate controller, -feedback * J * measured rate,
    so that the noise of the gyro reaches the torque as in real flight.
    """
    shelf = SHELVES.get("vehicles")
    # Where a module is only imported, nothing is kept yet.
    if shelf is None:
        return _flown(truth, excitation, seed, feedback)
    key = content_key(truth, excitation, seed, feedback)
    return shelf.get(key, lambda: _flown(truth, excitation, seed, feedback))


def _flown(truth: Truth, excitation: np.ndarray, seed: int, feedback: float) -> FlightData:
    rng = np.random.default_rng(seed)
    n, step = len(excitation), PERIOD_S / _SUBSTEPS
    noise = truth.noise_rad_s * rng.standard_normal((n, 3))
    decay = math.exp(-step / truth.lag_s) if truth.lag_s else 0.0
    behind = round(truth.delay_s / step)
    # In plain floats: this runs a hundred thousand times.
    J, B = _Rows(truth.inertia), _Rows(truth.B)
    gain, drag = feedback, truth.quadratic_roll_damping
    (jxx, jxy, jxz), (jyx, jyy, jyz), (jzx, jzy, jzz) = truth.inertia.tolist()
    (bxx, bxy, bxz), (byx, byy, byz), (bzx, bzy, bzz) = truth.B.tolist()
    (dxx, dxy, dxz), (dyx, dyy, dyz), (dzx, dzy, dzz) = truth.damping.tolist()

    def slope(w: Triple, push: Triple) -> Triple:
        p, q, r = w
        # The moment of momentum, and its cross product with the rate.
        x, y, z = jxx * p + jxy * q + jxz * r, jyx * p + jyy * q + jyz * r, jzx * p + jzy * q + jzz * r
        a, b, c = q * z - r * y, r * x - p * z, p * y - q * x
        return (
            push[0] - (bxx * a + bxy * b + bxz * c) - (dxx * p + dxy * q + dxz * r),
            push[1] - (byx * a + byy * b + byz * c) - (dyx * p + dyy * q + dyz * r),
            push[2] - (bzx * a + bzy * b + bzz * c) - (dzx * p + dzy * q + dzz * r),
        )

    rates, commands, wanted = [], [], [(0.0, 0.0, 0.0)] * behind
    w: Triple = (0.0, 0.0, 0.0)
    actual = w
    for excited, disturbed in zip(excitation.tolist(), noise.tolist(), strict=True):
        rate = (w[0] + disturbed[0], w[1] + disturbed[1], w[2] + disturbed[2])
        held = J.times(rate)
        command = (excited[0] - gain * held[0], excited[1] - gain * held[1], excited[2] - gain * held[2])
        rates.append(rate)
        commands.append(command)
        for _ in range(_SUBSTEPS):
            wanted.append(command)
            x, y, z = wanted[len(wanted) - 1 - behind]
            actual = (x + (actual[0] - x) * decay, y + (actual[1] - y) * decay, z + (actual[2] - z) * decay)
            p, q, r = B.times(actual)
            push = (p - drag * w[0] * abs(w[0]), q, r)
            middle = _moved(w, slope(w, push), 0.5 * step)
            w = _moved(w, slope(middle, push), step)
    rate, command = np.array(rates), np.array(commands)
    if np.isfinite(truth.gyro_filter_hz):
        s = angular_frequency(n, PERIOD_S)
        response = butterworth_response(s, truth.gyro_filter_hz)[:, np.newaxis]
        rate = np.fft.irfft(np.fft.rfft(rate, axis=0) * response, n, axis=0)
    return flight_data(rate, command, gyro_filter=GyroFilter(truth.gyro_filter_hz))


def fly_in_gusts(
    frequencies_hz: np.ndarray,
    gust_rad_s2: float,
    *,
    memory_s: float = 2.0,
    duration_s: float = 40.0,
    seed: int = 1,
) -> FlightData:
    """Fly `QUAD` by a PI rate loop in slow gusts that no log tells; setpoints are not logged either."""
    rng = np.random.default_rng(seed)
    n, J, D = int(duration_s / PERIOD_S), np.diag(QUAD.inertia), np.diag(QUAD.damping)
    t = PERIOD_S * np.arange(n)
    wanted = np.zeros((n, 3))
    for axis in range(3):
        for frequency in frequencies_hz * (1.0 + 0.05 * axis):
            wanted[:, axis] += np.sin(2.0 * np.pi * frequency * t + rng.uniform(0.0, 2.0 * np.pi))
    wanted *= 0.3 / np.sqrt(frequencies_hz.size / 2.0)
    fade, decay = math.exp(-PERIOD_S / memory_s), math.exp(-PERIOD_S / QUAD.lag_s)
    gusts = gust_rad_s2 * np.sqrt(1.0 - fade**2) * rng.standard_normal((n, 3))
    noise = 0.003 * rng.standard_normal((n, 3))
    rates, commands = [], []
    w, actual, gust, total = ([0.0] * 3 for _ in range(4))
    jx, jy, jz = J.tolist()
    each = tuple(zip(J.tolist(), D.tolist(), strict=True))
    # In plain floats, as above.
    for now in zip(wanted.tolist(), noise.tolist(), gusts.tolist(), strict=True):
        seen, sent = [], []
        p, q, r = w
        turned = (q * jz * r - r * jy * q, r * jx * p - p * jz * r, p * jy * q - q * jx * p)
        for axis, inertia in enumerate(J.tolist()):
            target, heard, blown = now[0][axis], now[1][axis], now[2][axis]
            seen.append(w[axis] + heard)
            error = target - seen[axis]
            total[axis] += 20.0 * PERIOD_S * error
            sent.append(inertia * (15.0 * error + total[axis]))
            actual[axis] = sent[axis] + (actual[axis] - sent[axis]) * decay
            gust[axis] = fade * gust[axis] + blown
        w = [
            rate + PERIOD_S * ((made - cross) / inertia - damping * rate + push)
            for rate, made, cross, (inertia, damping), push in zip(w, actual, turned, each, gust, strict=True)
        ]
        rates.append(seen)
        commands.append(sent)
    rate, command = np.array(rates), np.array(commands)
    return flight_data(rate, command)


class _Rows:
    """A matrix of shape (3, 3) as plain floats."""

    def __init__(self, matrix: np.ndarray) -> None:
        self._x, self._y, self._z = (tuple(row) for row in matrix.tolist())

    def times(self, v: Triple) -> Triple:
        a, b, c = v
        x, y, z = self._x, self._y, self._z
        return (
            x[0] * a + x[1] * b + x[2] * c,
            y[0] * a + y[1] * b + y[2] * c,
            z[0] * a + z[1] * b + z[2] * c,
        )


def _moved(w: Triple, slope: Triple, by_s: float) -> Triple:
    return w[0] + by_s * slope[0], w[1] + by_s * slope[1], w[2] + by_s * slope[2]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A flight drawn at random, with its truth: on-axis effectiveness and damping, each (3,)."""

    data: FlightData
    gain: np.ndarray
    damping: np.ndarray


def draw_flights(n_flights: int, duration_s: float, *, seed: int, gyro_sigma: float) -> list[Drawn]:
    """Integrate many random flights side by side: other vehicles, manoeuvres, gusts and gyros.

    Gusts are torques that no log tells, with a memory of 0.15 s. The torque is flown as planned, without
    feedback, and is the instrument as well: the estimate has no bias, and its intervals are what is tested.
    ``gyro_sigma`` is that of each scale and cross-axis error of the gyro.
    """
    rng = np.random.default_rng(seed)
    moments = np.array([0.010, 0.012, 0.020]) * rng.uniform(0.8, 1.25, (n_flights, 3))
    damping = rng.uniform(0.8, 2.5, (n_flights, 3))
    lag_s, behind = rng.uniform(0.015, 0.06, (n_flights, 1)), rng.integers(1, 5, n_flights)
    t = np.arange(0.0, duration_s, PERIOD_S)
    command = np.zeros((t.size, n_flights, 3))
    for k in range(6):
        frequency = rng.uniform(0.4 + 0.55 * k, 0.7 + 0.55 * k, (n_flights, 3))
        command += np.sin(2.0 * np.pi * frequency * t[:, None, None] + rng.uniform(0.0, 6.3, (n_flights, 3)))
    command *= 12.0 * moments
    gust, fade = np.zeros((n_flights, 3)), np.exp(-PERIOD_S / 0.15)
    decay = np.exp(-PERIOD_S / lag_s)
    rate, actual, logged = np.zeros((n_flights, 3)), np.zeros((n_flights, 3)), np.empty_like(command)
    for now in range(t.size):
        logged[now] = rate
        wanted = command[np.maximum(now - behind, 0), np.arange(n_flights)]
        gust = fade * gust + 4.0 * np.sqrt(1.0 - fade**2) * moments * rng.standard_normal((n_flights, 3))
        before, actual = actual, wanted + (actual - wanted) * decay
        torque = 0.5 * (before + actual) + gust

        def slope(w: np.ndarray, torque: np.ndarray = torque) -> np.ndarray:
            return (torque - np.cross(w, moments * w)) / moments - damping * w

        middle = rate + 0.5 * PERIOD_S * slope(rate)
        rate = rate + PERIOD_S * slope(middle)
    flights = []
    for number in range(n_flights):
        E = gyro_sigma * rng.standard_normal((3, 3))
        shown = logged[:, number] @ (np.eye(3) + E).T + 0.002 * rng.standard_normal((t.size, 3))
        data = flight_data(shown, command[:, number])
        (segment,) = data.segments
        planned = replace(segment, reference=command[:, number] / moments[number])
        flights.append(
            Drawn(
                data=replace(data, segments=(planned,)),
                gain=1.0 / moments[number],
                damping=damping[number],
            )
        )
    return flights


def flight_data(rate: np.ndarray, torque: np.ndarray, **changes: object) -> FlightData:
    """Return one aligned segment of the given series at 400 Hz, torque in N m."""
    time_s = PERIOD_S * np.arange(len(rate))
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=rate,
        torque=torque,
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(len(rate), dtype=bool),
    )
    fields: dict[str, object] = {
        "sample_period_s": PERIOD_S,
        "segments": (segment,),
        "flights": ((0.0, float(time_s[-1])),),
        "sources": {},
        "input": InputDescription(kind="torque_n_m", unit="N m", source="test"),
        "start_s": 0.0,
        "duration_s": float(time_s[-1]),
    }
    return FlightData(**{**fields, **changes})  # type: ignore[arg-type]
