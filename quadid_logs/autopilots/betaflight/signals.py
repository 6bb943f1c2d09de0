"""Betaflight's Blackbox fields in canonical signals: one table, the preferred source of each signal first.

Field meanings: ``src/main/blackbox/blackbox.c``. Betaflight's axes are x forward, y left, z up, so pitch
(nose down positive) and yaw (nose left positive) change sign. PID terms are whole numbers of thousandths:
rounded since 4.4, cut towards zero before.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.chirp import Sweep, excitation, sweep_of
from quadid_logs.autopilots.sources import (
    RPM,
    Built,
    Part,
    Source,
    attitude_columns,
    stacked,
    used_columns,
)
from quadid_logs.containers.blackbox import FrameTable
from quadid_logs.containers.blackbox_header import Header
from quadid_logs.vocabulary import AXES

_Part: TypeAlias = Part[FrameTable]
_Row: TypeAlias = Source[Any]

#: x forward, y left, z up to x forward, y right, z down.
TO_FRD: Final = np.array([1.0, -1.0, -1.0])
_DEGREE: Final = np.pi / 180.0
_GRAVITY: Final = 9.80665
#: A PID sum of 1000 is the whole range of the mixer (``mixer.c``, PID_MIXER_SCALING).
PID_SCALE: Final = 1e-3
#: The setting that limits the PID sum of an axis, and its default (``pid.h``, PIDSUM_LIMIT).
PID_SUM_LIMITS: Final = {
    "roll": ("pidsum_limit", 500),
    "pitch": ("pidsum_limit", 500),
    "yaw": ("pidsum_limit_yaw", 400),
}
#: blackbox_high_resolution logs rates and set-points in tenths.
_HIGH_RESOLUTION: Final = 0.1
#: The change that brought this setting, in 4.4, also rounded the terms; all headers have held it since.
_SINCE_ROUNDED: Final = "blackbox_high_resolution"
_QUATERNION_ONE: Final = 32767.0
_CHUNK: Final = 1 << 15


@dataclass(frozen=True, slots=True)
class Facts:
    """What the header says of the fields' scales."""

    rate: float
    acceleration: float
    pid_sum_limits: tuple[float, float, float]
    lowest_output: float
    highest_output: float
    pole_pairs: float
    cuts_terms: bool
    sweep: Sweep | None

    @classmethod
    def of(cls, header: Header) -> Facts:
        """Read the header; what is missing there has the firmware's default."""
        low, high = [*header.texts.get("motorOutput", "").split(","), "", ""][:2]
        roll, pitch, yaw = (header.number(*PID_SUM_LIMITS[axis]) for axis in AXES)
        return cls(
            rate=_HIGH_RESOLUTION if header.number("blackbox_high_resolution") else 1.0,
            acceleration=_GRAVITY / max(header.number("acc_1G", 2048), 1),
            pid_sum_limits=(roll, pitch, yaw),
            lowest_output=float(low) if low.strip().isdecimal() else np.nan,
            highest_output=float(high) if high.strip().isdecimal() else np.nan,
            pole_pairs=max(header.number("motor_poles", 14), 2) / 2.0,
            cuts_terms=cuts_terms(header.texts),
            sweep=sweep_of(header.texts),
        )


def cuts_terms(settings: Container[str]) -> bool:
    """Tell whether terms were cut towards zero, by the names of a header: rounded ones are those of 4.4 on.

    Parameters
    ----------
    settings : container of str

    Returns
    -------
    bool
    """
    return _SINCE_ROUNDED not in settings


def middle(whole: NDArray[Any], *, cut: bool) -> NDArray[Any]:
    """Return the middle of the values that became each whole number.

    Parameters
    ----------
    whole : ndarray
    cut : bool
        Towards zero: 3 stands for 3 to 4, and 0 for -1 to 1.

    Returns
    -------
    ndarray, shape of `whole`
    """
    return whole + 0.5 * np.sign(whole) if cut else whole


def _columns(part: _Part, source: _Row) -> FloatArray | None:
    """Put the fields side by side in single precision, which holds these whole numbers in half the memory."""
    return stacked(part.table, source.fields, source.scale, np.float32)


def _rates(part: _Part, source: _Row) -> FloatArray | None:
    """Turn degrees per second, or tenths of them, into rad/s, FRD."""
    rates = _columns(part, source)
    if rates is not None:
        rates *= _DEGREE * part.log.rate * TO_FRD
    return rates


def _acceleration(part: _Part, source: _Row) -> FloatArray | None:
    """Turn counts into m/s^2, FRD."""
    counts = _columns(part, source)
    if counts is not None:
        counts *= part.log.acceleration * TO_FRD
    return counts


def _pid_sums(part: _Part, source: _Row) -> FloatArray | None:
    """Sum the terms that are logged, limit the sum as the mixer does, FRD."""
    cut = part.log.cuts_terms
    sums = _columns(part, source)
    if sums is None:
        return None
    others = [(number % 3, part.table.column(field)) for number, field in enumerate(source.optional)]
    limits = np.array(part.log.pid_sum_limits)
    # In chunks: every term comes and goes in its middle.
    for first in range(0, len(sums), _CHUNK):
        rows = slice(first, first + _CHUNK)
        some = middle(sums[rows], cut=cut)
        for axis, column in others:
            if column is not None:
                some[:, axis] += middle(column[rows], cut=cut)
        sums[rows] = np.clip(some, -limits, limits) * (PID_SCALE * TO_FRD)
    return sums


def _attitude(part: _Part, source: _Row) -> FloatArray | None:
    """Euler angles of x, y, z of a quaternion with w >= 0, body forward-left-up to Earth north-west-up."""
    xyz = _columns(part, source)
    if xyz is None:
        return None
    # In chunks of double precision: a dozen columns come and go on the way.
    for first in range(0, len(xyz), _CHUNK):
        some = xyz[first : first + _CHUNK].astype(np.float64) / _QUATERNION_ONE
        w = np.sqrt(np.clip(1.0 - np.sum(some**2, axis=1), 0.0, None))
        xyz[first : first + _CHUNK] = attitude_columns(np.column_stack([w, some * TO_FRD]))
    return xyz


def _motors(part: _Part, source: _Row) -> FloatArray | None:
    """Return outputs as a fraction of the range from idle to full."""
    columns = _numbered(part, source.fields[0])
    low, high = part.log.lowest_output, part.log.highest_output
    if columns is None or not high > low:
        return None
    columns -= low
    columns /= high - low
    return np.clip(columns, 0.0, 1.0, out=columns)


def _rotor_speed(part: _Part, source: _Row) -> FloatArray | None:
    """Turn hundreds of electrical revolutions per minute into rad/s; None where none ever turns."""
    columns = _numbered(part, source.fields[0])
    used = None if columns is None else used_columns(columns, columns > 0.0)
    if used is not None:
        used *= 100.0 * RPM / part.log.pole_pairs
    return used


def _numbered(part: _Part, field: str) -> FloatArray | None:
    """Return ``field[0]``, ``field[1]``, ... side by side, None without any."""
    names = [f"{field}[{number}]" for number in range(len(part.table.names))]
    present = names[: sum(name in part.table.names for name in names)]
    return stacked(part.table, present or [field], dtype=np.float32)


def _chirp(part: _Part, source: _Row) -> Built | None:
    """Take the excitation of the chirp mode, which the debug fields hold in one debug mode only."""
    fields = _columns(part, source)
    if fields is None or part.log.sweep is None or len(fields) < 2:
        return None
    found = excitation(fields, part.rows.time_s, part.log.sweep)
    return None if found is None else Built(found[:, np.newaxis])


def _axes(field: str) -> tuple[str, str, str]:
    return f"{field}[0]", f"{field}[1]", f"{field}[2]"


_DEBUG: Final = tuple(f"debug[{number}]" for number in range(4))


SOURCES: Final[tuple[Source[_Part], ...]] = (
    Source("body_rate", "main", _axes("gyroADC"), "the rate controller's own input, filtered", _rates,
           label="gyroADC", filtered=True),
    Source("body_rate", "main", _axes("gyroUnfilt"), "the gyro before its filters, with all vibration",
           _rates, label="gyroUnfilt"),
    Source("body_rate_setpoint", "main", _axes("setpoint"), "the rate controller's set-point", _rates,
           label="setpoint"),
    Source("sysid_chirp", "main", _DEBUG, "excitation of the chirp mode", _chirp, label="debug[0..3]"),
    Source("attitude", "main", _axes("imuQuaternion"), "the estimator's attitude", _attitude,
           label="imuQuaternion"),
    Source("torque_command", "main", _axes("axisP"), "the rate controller's output, limited as by the mixer",
           _pid_sums, label="axisP+I+D+F",
           optional=tuple(field for term in "IDFS" for field in _axes(f"axis{term}"))),
    Source("throttle", "main", ("setpoint[3]",), "throttle before the mixer", _columns,
           scale=PID_SCALE),
    Source("motor_thrust", "main", ("motor",), "what each motor was sent, from idle to full", _motors),
    Source("rotor_speed", "main", ("eRPM",), "reported by the ESCs (bidirectional DShot)", _rotor_speed),
    Source("specific_force", "main", _axes("accSmooth"), "the accelerometer, filtered", _acceleration,
           label="accSmooth"),
    Source("battery_voltage", "main", ("vbatLatest",), "measured", _columns, scale=0.01),
)  # fmt: skip

#: What the builders take beside the fields of the table.
FIELDS: Final = (
    *(field for source in SOURCES for field in (*source.fields, *source.optional)),
    *(f"{field}[{number}]" for field in ("motor", "eRPM") for number in range(8)),
)
