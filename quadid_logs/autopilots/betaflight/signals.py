"""Betaflight's Blackbox fields in canonical signals: one table, the preferred source of each signal first.

Field meanings: ``src/main/blackbox/blackbox.c``. Betaflight's axes are x forward, y left, z up, so pitch
(nose down positive) and yaw (nose left positive) change sign. PID terms are whole numbers of thousandths:
rounded since 4.4, cut towards zero before.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.betaflight.chirp import Sweep, excitation, sweep_of
from quadid_logs.autopilots.betaflight.header_names import gyro_scale
from quadid_logs.autopilots.betaflight.law import GYRO_SCALED_SINCE, UNFILTERED_SINCE
from quadid_logs.autopilots.betaflight.sticks import STICK_END, Sticks, sticks_of, straight_by_p, told_by_p
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
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2

_Part: TypeAlias = Part[FrameTable]
_Row: TypeAlias = Source[Any]

#: x forward, y left, z up to x forward, y right, z down.
TO_FRD: Final = np.array([1.0, -1.0, -1.0])
_DEGREE: Final = np.pi / 180.0
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
#: The debug mode that logs the gyro before its filters [deg/s] (debug.h; gyro_filter_impl.c,
#: DEBUG_GYRO_SCALED); before and after its versions the number is that of another mode.
_GYRO_SCALED: Final = 6
#: The change that brought this setting, in 4.4, also rounded the terms; all headers have held it since.
_SINCE_ROUNDED: Final = "blackbox_high_resolution"
#: The log's name of the sticks that set-points are made of.
STICK: Final = "rcCommand"
_QUATERNION_ONE: Final = 32767.0
_CHUNK: Final = 1 << 15


#: `rcCommand[3]` at no and full throttle, where it is a stick and not yet an output: from `min_check`, which
#: no header holds, by its default before 3.2 and since.
_MIN_CHECK, _MIN_CHECK_SINCE, _FULL_STICK = (1100.0, 1050.0), (3, 2), 2000.0
_SET_POINTS_SINCE: Final = (4, 0)
#: Before 4.0 a cell's limits, and the voltage, are in tenths of a volt; a limit of a hundred tenths is none.
_TENTHS_BELOW: Final = 100
#: Voltages before 3.1 are the converter's counts: of 4095 for 3.3 V, behind a divider of `vbatscale` / 10.
_COUNT: Final = 3.3 / 4095.0 / 10.0
#: The most cells that the firmware counts: what would be more of them is no voltage.
_MOST_CELLS: Final = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What header and modes say of the fields' scales.

    Attributes
    ----------
    rate, gyro, acceleration, voltage : float
        Units of the fields: set-points and gyro [deg/s], accelerometer [m/s^2], battery [V].
    has_set_points, has_throttle : bool
        They are logged, behind the curves of the sticks.
    debug_is_gyro : bool
        The debug fields hold the gyro before its filters.
    sticks : Sticks or None
        Where the header tells how sticks ask for rates.
    straight : ndarray, shape (3,), or None
        What a unit of each stick asks for [deg/s], where P tells it and no header does.
    levels : ndarray of bool, shape (n_rows,)
        Rows in which sticks ask for angles.
    throttle_range : tuple of float
        Of ``rcCommand[3]``.
    """

    rate: float
    gyro: float
    acceleration: float
    voltage: float
    pid_sum_limits: tuple[float, float, float]
    lowest_output: float
    highest_output: float
    throttle_range: tuple[float, float]
    pole_pairs: float
    cuts_terms: bool
    has_set_points: bool
    has_throttle: bool
    debug_is_gyro: bool
    sticks: Sticks | None
    straight: FloatArray | None
    levels: BoolArray
    sweep: Sweep | None

    @classmethod
    def of(
        cls,
        header: Header,
        settings: Mapping[str, float],
        version: tuple[int, ...] | None,
        main: FrameTable,
        levels: BoolArray,
    ) -> Facts:
        """Read the header; what is missing there has the firmware's default.

        Parameters
        ----------
        settings : mapping of str to float
            Its numbers, by the names of `header_names`.
        main : FrameTable
            Before any of its fields is gone.
        levels : ndarray of bool, shape (n_rows,)
        """
        tenths = _HIGH_RESOLUTION if header.number("blackbox_high_resolution") else 1.0
        roll, pitch, yaw = (settings.get(*PID_SUM_LIMITS[axis]) for axis in AXES)
        low, high = (settings.get(f"motorOutput[{end}]", np.nan) for end in (0, 1))
        scale = gyro_scale(header.texts)
        # Before 3.1 throttle, PID sums and outputs are in microseconds, and the gyro in counts of the sensor.
        counts = scale != 1.0
        at_rest = header.number("acc_1G", 2048)
        return cls(
            rate=tenths,
            gyro=tenths * scale,
            # Without a sensor the header says 0.
            acceleration=GRAVITY_M_S2 / at_rest if at_rest > 0 else np.nan,
            voltage=_volts(header, settings),
            pid_sum_limits=(abs(roll), abs(pitch), abs(yaw)),
            lowest_output=low,
            highest_output=high,
            throttle_range=(low, high)
            if counts
            else (_MIN_CHECK[(version is None or version >= _MIN_CHECK_SINCE)], _FULL_STICK),
            pole_pairs=max(header.number("motor_poles", 14), 2) / 2.0,
            cuts_terms=cuts_terms(header.texts),
            has_set_points="setpoint[0]" in main.names,
            has_throttle="setpoint[3]" in main.names,
            debug_is_gyro=header.number("debug_mode") == _GYRO_SCALED
            and version is not None
            and GYRO_SCALED_SINCE <= version < UNFILTERED_SINCE,
            # Later ones log set-points, unless told not to, and smooth them behind the sticks.
            sticks=None
            if counts or version is None or version >= _SET_POINTS_SINCE
            else _sticks(main, settings, version, levels),
            straight=_straight(main, scale, levels) if counts else None,
            levels=levels,
            sweep=sweep_of(header.texts),
        )


def _volts(header: Header, settings: Mapping[str, float]) -> float:
    """Return what a unit of the battery's voltage is [V]."""
    most = settings.get("vbatcellvoltage[2]", np.nan)
    if not 0.0 < most < _TENTHS_BELOW:
        return 0.01
    if header.number("vbatref") <= _MOST_CELLS * most:
        return 0.1
    return _COUNT * settings.get("vbatscale", 110.0)


def cuts_terms(settings: Container[str]) -> bool:
    """Tell whether terms were cut towards zero, by a header's names: rounded ones are those of 4.4 on."""
    return _SINCE_ROUNDED not in settings


def middle(whole: NDArray[Any], *, cut: bool) -> NDArray[Any]:
    """Return the middle of the values that became each whole number.

    Parameters
    ----------
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


def _turned(part: _Part, source: _Row, unit: Callable[[Facts], float]) -> FloatArray | None:
    """Turn rates, forward-left-up, in a unit [deg/s] into rad/s, FRD; None for a unit that is none."""
    rates, unit_dps = _columns(part, source), unit(part.log)
    if rates is None or not np.isfinite(unit_dps):
        return None
    rates *= _DEGREE * unit_dps * TO_FRD
    return rates


_set_points: Final = partial(_turned, unit=lambda facts: facts.rate)
_gyro: Final = partial(_turned, unit=lambda facts: facts.gyro)
_debug_gyro: Final = partial(_turned, unit=lambda facts: 1.0 if facts.debug_is_gyro else np.nan)


def _by_sticks(part: _Part, source: _Row) -> Built | None:
    """Make set-points from the sticks where no others are logged; unknown where sticks ask for angles."""
    facts: Facts = part.log
    command = None if facts.has_set_points or facts.levels.all() else _columns(part, source)
    if command is None:
        return None
    if facts.sticks is not None:
        found = facts.sticks.set_points(command * facts.rate, part.rows.time_s)
        note = "by the stick rates in the header"
    elif facts.straight is not None:
        found, note = command * facts.straight, "scaled by what the P terms consist of"
    else:
        return None
    found *= _DEGREE * TO_FRD
    found[facts.levels] = np.nan
    return Built(found.astype(np.float32), note)


def _angle_sticks(part: _Part, source: _Row) -> FloatArray | None:
    """Return the sticks of roll and pitch, -1 to 1, FRD, where they ask for angles in some rows."""
    facts: Facts = part.log
    sticks = _columns(part, source) if facts.has_set_points and facts.levels.any() else None
    if sticks is not None:
        sticks *= facts.rate / STICK_END * TO_FRD[:2]
    return sticks


def _sticks(
    main: FrameTable, settings: Mapping[str, float], version: tuple[int, ...], levels: BoolArray
) -> Sticks | None:
    """Return the curves of the sticks, of the kind that P tells where the header does not."""
    found, logged = sticks_of(settings, version), _of_p(main)
    if found is None or logged is None or "rates_type" in settings or levels.all():
        return found
    rows = np.flatnonzero(~levels)
    rows = rows[:: max(1, len(rows) // _CHUNK)]
    return told_by_p(found, version, *(each[rows] for each in logged))


def _of_p(main: FrameTable) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return what P is made of, sticks and gyro, and P, as logged; None where one of them is not."""
    found = [stacked(main, _axes(field), dtype=np.float32) for field in (STICK, "gyroADC", "axisP")]
    command, gyro, p = found
    return None if command is None or gyro is None or p is None else (command, gyro, p)


def _straight(main: FrameTable, scale: float, levels: BoolArray) -> FloatArray | None:
    """Return what a unit of each stick asks for [deg/s], by P."""
    logged = _of_p(main)
    if logged is None or not np.isfinite(scale):
        return None
    command, gyro, p = logged
    return straight_by_p(command, gyro * scale, p, ~levels)


def _throttle(part: _Part, source: _Row) -> FloatArray | None:
    """Return the stick's throttle from 0 to 1, where the mixer's is not logged."""
    low, high = part.log.throttle_range
    stick = None if part.log.has_throttle else _columns(part, source)
    if stick is None or not high > low:
        return None
    stick *= part.log.rate
    return np.clip((stick - low) / (high - low), 0.0, 1.0, out=stick)


def _voltage(part: _Part, source: _Row) -> FloatArray | None:
    """Return volts."""
    volts = _columns(part, source)
    if volts is not None:
        volts *= part.log.voltage
    return volts


def _acceleration(part: _Part, source: _Row) -> FloatArray | None:
    """Turn counts into m/s^2, FRD."""
    counts = _columns(part, source)
    # Without a sensor all counts are 0.
    if counts is None or not np.isfinite(part.log.acceleration) or not counts.any():
        return None
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
    Source("body_rate", "main", _axes("gyroADC"), "the rate controller's own input, filtered", _gyro,
           label="gyroADC", filtered=True),
    Source("body_rate", "main", _axes("gyroUnfilt"), "the gyro before its filters, with all vibration",
           _gyro, label="gyroUnfilt", raw=True),
    Source("body_rate", "main", _DEBUG[:3], "the gyro before its filters, with all vibration", _debug_gyro,
           label="debug[0..2]", raw=True),
    Source("body_rate_setpoint", "main", _axes("setpoint"), "the rate controller's set-point", _set_points,
           label="setpoint"),
    Source("body_rate_setpoint", "main", _axes(STICK), "the sticks' command", _by_sticks,
           label=STICK),
    Source("stick", "main", _axes(STICK)[:2], "the sticks' command in angle modes", _angle_sticks,
           label="rcCommand[0..1]"),
    Source("sysid_chirp", "main", _DEBUG, "excitation of the chirp mode", _chirp, label="debug[0..3]"),
    Source("attitude", "main", _axes("imuQuaternion"), "the estimator's attitude", _attitude,
           label="imuQuaternion"),
    Source("torque_command", "main", _axes("axisP"),
           "the rate controller's output, limited like in the mixer",
           _pid_sums, label="axisP+I+D+F",
           optional=tuple(field for term in "IDFS" for field in _axes(f"axis{term}"))),
    Source("throttle", "main", ("setpoint[3]",), "throttle before the mixer", _columns,
           scale=PID_SCALE),
    Source("throttle", "main", ("rcCommand[3]",), "throttle of the stick", _throttle),
    Source("motor_thrust", "main", ("motor",), "the command of each motor, from idle to full", _motors),
    Source("rotor_speed", "main", ("eRPM",), "reported by the ESCs (bidirectional DShot)", _rotor_speed),
    Source("specific_force", "main", _axes("accSmooth"), "the accelerometer, filtered", _acceleration,
           label="accSmooth"),
    Source("battery_voltage", "main", ("vbatLatest",), "measured", _voltage),
)  # fmt: skip
