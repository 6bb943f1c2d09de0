"""ArduPilot's messages as canonical signals: one table, the preferred source of each signal first.

Units and signs: libraries/AP_Logger/LogStructure.h, AC_AttitudeControl_Logging.cpp
and AP_MotorsMulticopter.cpp of ArduPilot. Body axes are FRD and angles are
right-handed throughout, as in the vocabulary; only scales differ.
"""

from __future__ import annotations

import math
import re
import string
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, partial
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.autopilots.ardupilot.clock import TIME_LABELS, LogClock
from quadid_logs.autopilots.sources import RPM, Built, Part, Source, messages_of, plain, stacked
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import ControllerTerms, Rows
from quadid_logs.vocabulary import AXES

DEGREE: Final = math.pi / 180.0
#: Full scale of the rate controller's output before ArduPilot 3.4 (ArduCopter/Parameters.cpp,
#: convert_pid_parameters: "-1 to +1 range instead of -4500 ~ +4500").
_OLD_COMMAND_SCALE: Final = 4500.0
_OLD_COMMAND_NOTE: Final = (
    "divided by 4500, the full scale before firmware 3.4 (its mixer gave roll and pitch 0.71 of today's "
    "effect on X, V and H quads)"
)
_NEW_COMMAND_SINCE: Final = (3, 4)
#: The sum of PID terms is not limited and may reach 5; on the old scale it is hundreds in any flight.
_LARGEST_COMMAND: Final = 20.0
#: Above it, a throttle of 0 to 1 is one of 0 to 1000.
_LARGEST_THROTTLE: Final = 2.0
#: No multirotor battery has more; an integer column in hundredths of a volt starts far above.
_LARGEST_BATTERY_V: Final = 100.0
#: ISA: temperature lapse [K/m], gas constant of air [J/(kg K)], sea-level density [kg/m^3].
_LAPSE_K_M: Final = 0.0065
_GAS_CONSTANT: Final = 287.26
_SEA_LEVEL_DENSITY: Final = 1.225
#: Density in the troposphere of the 1976 standard atmosphere: (1 - 0.0065 h / 288.15)^(g/(R L) - 1).
_STANDARD_LAPSE_1_M: Final = 0.0065 / 288.15
_STANDARD_EXPONENT: Final = 4.2559
#: Rows by which the magnitude of a series is known well enough.
_ENOUGH: Final = 100_000
#: ESC telemetry of one cycle lies closer together than this.
_ESC_CYCLE_S: Final = 0.5
#: Of one axis each; a loop logs them one after the other.
PID_MESSAGES: Final = ("PIDR", "PIDP", "PIDY")
_TERMS: Final = {"P": "P", "I": "I", "D": "D", "FF": "FF", "scale": "Dmod"}
#: Written with RATE, at its stamps, while a scale is not 1: factors on P and D by axis.
SCALE_MESSAGE: Final = "ATSC"
_SCALE_LABELS: Final = dict(zip(AXES, ("PDScX", "PDScY", "PDScZ"), strict=True))
TERM_LABELS: Final = frozenset({*_TERMS.values(), "DFF", "Flags", *_SCALE_LABELS.values()})


class Split(Enum):
    """How the rows of a message are told apart, by the first of these columns that there is."""

    WHOLE = ()
    FIRST = ("I", "Instance", "Inst")
    """Only the first sensor counts."""
    SENSORS = ("I",)
    IMUS = ("IMU",)
    CORES = ("C",)
    """The core that was primary most of the time comes first."""


@dataclass(frozen=True, slots=True)
class DataFlashSource(Source["MessagePart"]):
    """A row of the table.

    Attributes
    ----------
    split : Split
    joined : tuple of str
        Further messages with the same fields for further channels or axes; one of all must be there.
    unless : str
        A message that makes the source superfluous: then it is not even read.
    """

    split: Split = Split.FIRST
    joined: tuple[str, ...] = ()
    unless: str = ""


class RateScale(NamedTuple):
    """Radians per second in one count of RATE's rates, and how that is known."""

    factor: float
    unit: str
    evidence: str
    is_stated: bool = False


class Messages:
    """The messages of one log with the clock, split by sensor.

    Parameters
    ----------
    tables : mapping of str to MessageTable
        What was read of the table's messages.
    clock : LogClock
        Gives every row its time.
    version : (int, int) or None
        Firmware version: tells the unit of RATE where nothing else does.
    """

    def __init__(
        self, tables: Mapping[str, MessageTable], clock: LogClock, version: tuple[int, int] | None
    ) -> None:
        # The rows of PIDR, PIDP and PIDY that belong to loops with all three.
        found = [tables[name] for name in PID_MESSAGES if name in tables]
        complete_loops: dict[str, MessageTable] = {}
        if len(found) == len(PID_MESSAGES):
            # Match rows of messages that each loop logs one after the other: R, P, Y without R between.
            positions = [table.position for table in found]
            first = positions[0]
            following = np.append(first[1:], np.iinfo(np.int64).max)
            matches = [np.searchsorted(other, first) for other in positions[1:]]
            complete = np.ones(len(first), np.bool_)
            for other, row in zip(positions[1:], matches, strict=True):
                inside = np.minimum(row, len(other) - 1)
                complete &= (row < len(other)) & (other[inside] < following)
            rows = [np.flatnonzero(complete), *(row[complete] for row in matches)]
            complete_loops = {
                table.name: table.rows(chosen) for table, chosen in zip(found, rows, strict=True)
            }
        self.tables = {**tables, **complete_loops}
        self.clock = clock
        self._old_firmware = version is not None and version < _NEW_COMMAND_SINCE
        self._known: dict[tuple[MessageTable, Split], list[tuple[int | None, MessageTable]]] = {}

    def parts(self, source: Source[MessagePart]) -> list[MessagePart]:
        """Return the rows of a source: one part a sensor or core, none where a field is missing."""
        found = self.named(source)
        if not isinstance(source, DataFlashSource) or not found or not found[0].has_numbers(*source.fields):
            return []
        # The number of each sensor or core with its rows, once for all signals.
        table, split = found[0], source.split
        if (table, split) not in self._known:
            instances = _instances(table, split.value)
            if split is Split.FIRST:
                instances = [(None, instances[0][1])]
            elif split is Split.CORES:
                # Put the core first that was the primary one most of the time.
                status = self.tables.get(table.name.replace("F1", "F4"))
                if len(instances) >= 2 and status is not None and status.has_numbers("PI"):
                    primary = status.integers("PI")
                    most = max(
                        (core[0] or 0 for core in instances),
                        key=lambda core: np.count_nonzero(primary == core),
                    )
                    instances = sorted(instances, key=lambda core: (core[0] != most, core[0]))
            self._known[table, split] = instances
        return [self._part(table, number, source.split) for number, table in self._known[table, split]]

    def named(self, source: Source[MessagePart]) -> list[MessageTable]:
        """Return the messages of a source that the log has."""
        joined = source.joined if isinstance(source, DataFlashSource) else ()
        return [self.tables[name] for name in (source.message, *joined) if name in self.tables]

    # Parts are not kept: with their way back to all messages these would outlive the reading.
    def _part(self, table: MessageTable, number: int | None, split: Split) -> MessagePart:
        name, note = (table.name, "") if number is None else (f"{table.name}[{number}]", f", core {number}")
        if split is Split.SENSORS:
            note = f" of sensor {_number_in(table.name) if number is None else number}"
        return MessagePart(name=name, table=table, rows=self.clock.rows(table), note=note, log=self)

    @cached_property
    def rate_scale(self) -> RateScale | None:
        """Unit of RATE's rates: by FMTU, else against the gyro, else by the firmware's version."""
        table = self.tables.get("RATE")
        measured = next(
            (age.measured for age in _RATE_AGES if table and table.has_numbers(*age.measured)), None
        )
        if table is None or measured is None:
            return None
        unit = table.units.get(measured[0])
        factors = {"deg/s": DEGREE, "rad/s": 1.0}
        if unit is not None and unit.label in factors:
            return RateScale(
                factors[unit.label] * unit.factor, unit.label, "the log states the unit", is_stated=True
            )
        # How many counts of RATE make one rad/s of the gyro; NaN without a moving gyro.
        gyro = next((part for row in GYROS for part in self.parts(row)), None)
        reference = _spread(stacked(gyro.table, _GYRO)) if gyro is not None else 0.0
        ratio = _spread(stacked(table, measured)) / reference if reference > 0.0 else math.nan
        scales = {"deg/s": DEGREE, "centidegrees/s": DEGREE / 100.0, "rad/s": 1.0}
        for name, factor in scales.items():
            if 1 / 3 < ratio * factor < 3:
                return RateScale(factor, name, "compared with the gyro")
        old = measured[0] == "Rll" or self._old_firmware
        name = "centidegrees/s" if old else "deg/s"
        return RateScale(scales[name], name, "assumed from the firmware's age")

    def command_scale(self, values: FloatArray) -> tuple[float, str]:
        """Return the factor to the scale of -1 to 1, and the words for it.

        Parameters
        ----------
        values : ndarray, shape (n_rows, 3)
            Commands as logged.

        Returns
        -------
        factor : float
        words : str
            "" where the factor is 1.
        """
        old_rate = self.rate_scale is not None and self.rate_scale.unit == "centidegrees/s"
        if _typical(values) > _LARGEST_COMMAND or old_rate or self._old_firmware:
            return 1.0 / _OLD_COMMAND_SCALE, _OLD_COMMAND_NOTE
        return 1.0, ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessagePart(Part[MessageTable]):
    """The rows of a message, or of one sensor in it, and the other messages."""

    log: Messages


_Row: TypeAlias = Source[MessagePart]


def _rate(part: MessagePart, source: _Row) -> Built | None:
    """Bring RATE's rates to rad/s, and say with the measured ones how the unit is known."""
    scale, values = part.log.rate_scale, plain(part, source)
    if scale is None or values is None:
        return None
    note = f"logged in {scale.unit} ({scale.evidence})" if source.signal == "body_rate" else ""
    return Built(_scaled(values, scale.factor), note)


def _command(part: MessagePart, source: _Row) -> Built | None:
    """Bring a torque command to the scale of -1 to 1."""
    values = plain(part, source)
    if values is None:
        return None
    factor, note = part.log.command_scale(values)
    return Built(_scaled(values, factor), note)


def _pid_sum(part: MessagePart, source: _Row) -> Built | None:
    """Sum terms of PIDR, PIDP and PIDY, row by row of the same loop."""
    terms, tables = (*source.fields, *source.optional), part.log.named(source)
    if len(tables) < len(PID_MESSAGES) or not all(table.has_numbers(*source.fields) for table in tables):
        return None
    values = np.column_stack(
        [
            sum((_float(table, term) for term in terms if table.has_numbers(term)), np.zeros(table.n_rows))
            for table in tables
        ]
    )
    names = "+".join(term for term in terms if part.table.has_numbers(term))
    return Built(values, source=f"{' '.join(PID_MESSAGES)} {names}")


def _pid_command(part: MessagePart, source: _Row) -> Built | None:
    terms = _pid_sum(part, source)
    if terms is None:
        return None
    factor, note = part.log.command_scale(terms.values)
    return terms._replace(values=_scaled(terms.values, factor), note=note)


def _pid_old_target(part: MessagePart, source: _Row) -> Built | None:
    """Take Des, where there is no Tar."""
    return None if part.table.has_numbers("Tar") else _pid_sum(part, source)


def _throttle_out(part: MessagePart, source: _Row) -> Built | None:
    """0 to 1; before firmware 3.4, 0 to 1000."""
    return _rescaled_above(plain(part, source), _LARGEST_THROTTLE, 1e-3, "per mille")


def _voltage(part: MessagePart, source: _Row) -> Built | None:
    """Volt; before firmware 3.4 hundredths; None where nothing is measured."""
    values = plain(part, source)
    if values is None or not np.any(np.nan_to_num(values)):
        return None
    return _rescaled_above(values, _LARGEST_BATTERY_V, 1e-2, "hundredths of a volt")


def _rescaled_above(values: FloatArray | None, limit: float, factor: float, unit: str) -> Built | None:
    """Multiply values that are typically above the limit: they are in another unit."""
    if values is None:
        return None
    return Built(_scaled(values, factor), f"logged in {unit}") if _typical(values) > limit else Built(values)


def _angles(part: MessagePart, source: _Row) -> FloatArray | None:
    """Turn degrees with yaw from 0 to 360 into radians with yaw from -pi to pi."""
    values = plain(part, source)
    if values is not None:
        values[values[:, 2] > math.pi, 2] -= 2.0 * math.pi
    return values


def _outputs(part: MessagePart, source: _Row) -> Built | None:
    """Put the output channels of messages with equally many rows side by side."""
    labelled = [(table, _channels(table)) for table in part.log.named(source)]
    labelled = [(table, labels) for table, labels in labelled if labels]
    if not labelled:
        return None
    first = labelled[0][0]
    joined = [(table, labels) for table, labels in labelled if table.n_rows == first.n_rows]
    found = (stacked(table, labels) for table, labels in joined)
    return Built(
        np.column_stack([values for values in found if values is not None]),
        source=" ".join(f"{table.name}.{labels[0]}..{labels[-1]}" for table, labels in joined),
        rows=part.log.clock.rows(first),
    )


def _esc_speeds(part: MessagePart, source: _Row) -> Built | None:
    """Put the ESCs' telemetry side by side; None where every value is zero."""
    clock = part.log.clock
    tables = (table for table in part.log.named(source) if table.has_numbers("RPM"))
    escs = [esc for table in tables for _, esc in _instances(table, ("Instance", "I", "Id"))]
    reference = max(escs, key=lambda table: table.n_rows)
    columns = []
    for esc in escs:
        # An ESC's speed in the logging cycle of each reference row, NaN where it is silent.
        rpm = np.abs(_float(esc, "RPM"))
        if esc is reference:
            columns.append(rpm)
        else:
            next_cycle = np.append(reference.position[1:], np.iinfo(np.int64).max)
            row = np.searchsorted(esc.position, next_cycle, side="left") - 1
            age = clock.rows(reference).time_s - clock.rows(esc).time_s[np.maximum(row, 0)]
            fresh = (row >= 0) & (np.abs(age) < _ESC_CYCLE_S)
            columns.append(np.where(fresh, rpm[np.maximum(row, 0)], np.nan))
    speeds = np.column_stack(columns)
    if not np.any(np.nan_to_num(speeds)):
        return None  # simulators and ESCs without telemetry log zeros
    return Built(speeds * source.scale, f"{len(escs)} ESCs", "ESC.RPM", clock.rows(reference))


def _standard_density(part: MessagePart, source: _Row) -> FloatArray | None:
    """AP_Baro::get_EAS2TAS_extended (4.7): the standard atmosphere 1976 at this altitude."""
    altitude = plain(part, source)
    if altitude is None:
        return None
    return np.asarray(np.clip(1.0 - _STANDARD_LAPSE_1_M * altitude, 0.0, 2.0) ** _STANDARD_EXPONENT)


def _measured_density(part: MessagePart, source: _Row) -> FloatArray | None:
    """AP_Baro::get_EAS2TAS (before 4.7)."""
    values = plain(part, source)
    if values is None:
        return None
    press, ground, altitude = values.T
    kelvin = ground + 273.15 - _LAPSE_K_M * altitude
    density = _GAS_CONSTANT * kelvin * _SEA_LEVEL_DENSITY
    ratio: FloatArray = np.divide(press, density, where=kelvin > 0.0, out=kelvin * np.nan)
    return ratio[:, None]


def _changes(part: MessagePart, source: _Row, meaning: dict[int, float], label: str) -> Built | None:
    """Build a state from the events of EV, by what each number means, and ARM that change it."""
    found: list[tuple[Rows, AnyArray, FloatArray]] = []
    for table in part.log.named(source):
        rows = part.log.clock.rows(table)
        if table.name == "EV" and table.has_numbers("Id"):
            ids = table.integers("Id")
            chosen = np.flatnonzero(np.isin(ids, list(meaning)))
            found.append((rows, chosen, np.array([meaning[number] for number in ids[chosen].tolist()])))
        elif table.name == "ARM" and table.has_numbers("ArmState"):
            found.append(
                (rows, np.arange(rows.n_samples), (table.columns["ArmState"] > 0).astype(np.float64))
            )
    if not sum(len(chosen) for _, chosen, _ in found):
        return None
    position = np.concatenate([rows.position[chosen] for rows, chosen, _ in found])
    time_s = np.concatenate([rows.time_s[chosen] for rows, chosen, _ in found])
    state = np.concatenate([values for _, _, values in found])
    order = np.argsort(position, kind="stable")
    if "ARM" not in part.log.tables:
        label = label.removeprefix("ARM.ArmState ")
    return Built(state[order, None], source=label, rows=Rows(time_s[order], position[order]))


class _RateAge(NamedTuple):
    """The columns of RATE in one age of the firmware."""

    measured: tuple[str, str, str]
    target: tuple[str, str, str]
    output: tuple[str, str, str]


#: Since 3.3, and before.
_RATE_AGES: Final = (
    _RateAge(("R", "P", "Y"), ("RDes", "PDes", "YDes"), ("ROut", "POut", "YOut")),
    _RateAge(("Rll", "Pit", "Yaw"), ("RllDes", "PitDes", "YawDes"), ("RllOut", "PitOut", "YawOut")),
    _RateAge(("Roll", "Pitch", "Yaw"), ("RollDes", "PitchDes", "YawDes"), ("RollOut", "PitchOut", "YawOut")),
)
_GYRO: Final = ("GyrX", "GyrY", "GyrZ")
_ACCELEROMETER: Final = ("AccX", "AccY", "AccZ")
_ANGLES: Final = ("Roll", "Pitch", "Yaw")
_ASKED_ANGLES: Final = tuple(f"Des{angle}" for angle in _ANGLES)
#: ArduCopter 3.0, Log_Write_Attitude: control_roll, control_pitch and nav_yaw, which the angle loops follow.
_OLD_ASKED_ANGLES: Final = ("RollIn", "PitchIn", "NavYaw")
_VIBRATION: Final = ("VibeX", "VibeY", "VibeZ")
_CHANNELS: Final = tuple(f"{prefix}{n}" for prefix in ("C", "Ch", "Chan", "Mot") for n in range(1, 33))
_ESCS: Final = tuple(f"ESC{number}" for number in range(1, 9))
_one: Final = DataFlashSource
_whole: Final = partial(DataFlashSource, split=Split.WHOLE)
_each: Final = partial(DataFlashSource, split=Split.SENSORS)
_core: Final = partial(DataFlashSource, build=_angles, scale=DEGREE, split=Split.CORES)
_estimated: Final = partial(DataFlashSource, split=Split.CORES, optional=("PI",))
_pids: Final = partial(_whole, joined=PID_MESSAGES[1:], unless="RATE")
_VELOCITY: Final = ("VN", "VE", "VD")
#: LogEvent of AP_Logger.h: ARMED and DISARMED; LAND_COMPLETE and NOT_LANDED.
_armed: Final = partial(_changes, meaning={10: 1.0, 11: 0.0}, label="ARM.ArmState EV.Id 10 11")
_landed: Final = partial(_changes, meaning={18: 1.0, 28: 0.0}, label="EV.Id 18 28")
#: AP_InertialSensor logs IMU from get_gyro(), behind the filters; GYR has raw samples.
GYROS: Final = (
    *(_each("body_rate", name, _GYRO, "gyro", filtered=True) for name in ("IMU", "IMU2", "IMU3")),
    *(_each("body_rate", name, _GYRO, "gyro", raw=True) for name in ("GYR", "GYR1", "GYR2", "GYR3")),
)

SOURCES: Final[tuple[DataFlashSource, ...]] = (
    *(_whole("body_rate", "RATE", age.measured,
             "the rate controller's filtered input, logged together with its output", _rate, filtered=True)
      for age in _RATE_AGES),
    *GYROS,
    _one("body_rate", "SIDD", ("Gx", "Gy", "Gz"), "system-ID mode: delta angle over time, unfiltered",
         scale=DEGREE, raw=True),
    _pids("body_rate", "PIDR", ("Act",), "input of the rate PIDs; RATE is missing", _pid_sum),
    *(_whole("body_rate_setpoint", "RATE", age.target, "the rate controller's target", _rate)
      for age in _RATE_AGES),
    _pids("body_rate_setpoint", "PIDR", ("Tar",), "target of the rate PIDs; RATE is missing", _pid_sum),
    _pids("body_rate_setpoint", "PIDR", ("Des",), "target of the rate PIDs; RATE is missing",
          _pid_old_target),
    _core("attitude", "ANG", _ANGLES, "attitude at the rate of the attitude loop"),
    _core("attitude", "ATT", _ANGLES, "attitude that the controller used"),
    _core("attitude", "XKF1", _ANGLES, "EKF3", optional=("PI",), beside=("XKF4",)),
    _core("attitude", "NKF1", _ANGLES, "EKF2", optional=("PI",), beside=("NKF4",)),
    _core("attitude", "EKF1", _ANGLES, "first EKF"),
    _core("attitude", "AHR2", _ANGLES, "secondary attitude estimate"),
    _estimated("velocity", "XKF1", _VELOCITY, "EKF3", beside=("XKF4",)),
    _estimated("velocity", "NKF1", _VELOCITY, "EKF2", beside=("NKF4",)),
    *(_core("attitude_setpoint", name, _ASKED_ANGLES, "target of the attitude controller")
      for name in ("ANG", "ATT")),
    _core("attitude_setpoint", "ATT", _OLD_ASKED_ANGLES, "target of the attitude controller before 3.1"),
    *(_whole("torque_command", "RATE", age.output, "the rate controller's output to the mixer", _command)
      for age in _RATE_AGES),
    _pids("torque_command", "PIDR", ("P",),
          "sum of the PID terms, without chirp or feed-forward added after them; RATE is missing",
          _pid_command, optional=("I", "D", "FF", "DFF")),
    _one("throttle", "RATE", ("AOut",), "logged with the torque command", _throttle_out),
    _one("throttle", "CTUN", ("ThO",), "output of the throttle controller", _throttle_out),
    _one("throttle", "CTUN", ("ThrOut",), "output of the throttle controller", _throttle_out),
    _one("throttle", "MOTB", ("ThrOut",), "throttle that reached the mixer"),
    _whole("output_pwm", "RCOU", (), "pulse width per output channel", _outputs, optional=_CHANNELS,
           joined=("RCO2", "RCO3")),
    _whole("output_pwm", "MOT", (), "pulse width per motor", _outputs, optional=_CHANNELS),
    _whole("rotor_speed", "ESC", ("RPM",), "telemetry", _esc_speeds, RPM, optional=("Instance", "I", "Id")),
    _whole("rotor_speed", _ESCS[0], ("RPM",), "telemetry", _esc_speeds, RPM, joined=_ESCS[1:], unless="ESC"),
    *(_each("specific_force", name, _ACCELEROMETER, "accelerometer")
      for name in ("IMU", "IMU2", "IMU3", "ACC", "ACC1", "ACC2", "ACC3")),
    DataFlashSource("vibration", "VIBE", _VIBRATION, "of one sensor", split=Split.IMUS),
    DataFlashSource("accelerometer_clips", "VIBE", ("Clip",), "of one sensor", split=Split.IMUS),
    _whole("accelerometer_clips", "VIBE", ("Clip0", "Clip1", "Clip2"), "of each sensor"),
    _one("battery_voltage", "BAT", ("Volt",), "voltage of the first battery", _voltage),
    _one("battery_voltage", "CURR", ("Volt",), "voltage of the first battery", _voltage),
    # A ratio, whatever its unit says.
    _one("battery_ratio", "MOTB", ("BatVolt",), "filtered voltage divided by MOT_BAT_VOLT_MAX"),
    _one("lift_max", "MOTB", ("LiftMax",), "as the mixer's compensation uses it"),
    _one("throttle_limit", "MOTB", ("ThLimit",), "by spool-up and battery current"),
    _one("throttle_average_max", "MOTB", ("ThrAvMx",), "ATC_THR_MIX_* and MOT_THST_HOVER at work"),
    _one("air_density_ratio", "BARO", ("AltAMSL",),
         "standard atmosphere 1976 at this altitude as AP_Baro::get_EAS2TAS_extended", _standard_density),
    _one("air_density_ratio", "BARO", ("Press", "GndTemp", "Alt"),
         "from pressure and ground temperature as AP_Baro::get_EAS2TAS", _measured_density),
    _whole("armed", "EV", (), "changes of state", _armed, optional=("Id", "ArmState"), joined=("ARM",)),
    _one("armed", "STAT", ("Armed",), "state that the vehicle reports again and again"),
    _whole("landed", "EV", (), "changes of state", _landed, optional=("Id",)),
    _one("sysid_chirp", "SIDD", ("Targ",), "chirp of the system-ID mode"),
)  # fmt: skip

#: Every column that a signal is built from, or its rows are told apart or timed by.
LABELS: Final = TIME_LABELS.union(
    *((*source.fields, *source.optional, *source.split.value) for source in SOURCES)
)


def controller_terms(tables: Mapping[str, MessageTable], clock: LogClock) -> tuple[ControllerTerms, ...]:
    """Return the terms of the rate PIDs by axis.

    Parameters
    ----------
    tables : mapping of str to MessageTable
        PIDR, PIDP, PIDY and ATSC as far as the log has them.

    Returns
    -------
    tuple of ControllerTerms
        An axis has two where its gains were scaled: those of ATSC hold nothing but ``gain_scale``.

    Notes
    -----
    AP_Logger/LogStructure.h: bit 0 of Flags is the mixer's limit; DFF is the derivative's feed-forward.
    """
    pids = tuple(
        ControllerTerms(axis=axis, rows=clock.rows(tables[name]), values=_pid_terms(tables[name]))
        for axis, name in zip(AXES, PID_MESSAGES, strict=True)
        if name in tables
    )
    return (*pids, *_gain_scales(tables.get(SCALE_MESSAGE), clock))


def _gain_scales(table: MessageTable | None, clock: LogClock) -> Iterator[ControllerTerms]:
    """Yield by axis the factors on P and D: throttle-gain boost, and gains for landing."""
    if table is None:
        return
    rows = clock.rows(table)
    for axis, label in _SCALE_LABELS.items():
        if table.has_numbers(label):
            yield ControllerTerms(axis=axis, rows=rows, values={"gain_scale": _float(table, label)})


def _pid_terms(table: MessageTable) -> dict[str, FloatArray]:
    terms = {term: _float(table, label) for term, label in _TERMS.items() if table.has_numbers(label)}
    if "FF" in terms and table.has_numbers("DFF"):
        terms["FF"] += _float(table, "DFF")
    if table.has_numbers("Flags"):
        terms["limited"] = (table.integers("Flags") & 1).astype(np.float64)
    return terms


def messages_to_read(present: Mapping[str, int]) -> frozenset[str]:
    """Return the messages from which a log that holds these would get its signals.

    Parameters
    ----------
    present : mapping of str to int
        Rows of each message in the log.
    """
    wanted = [source for source in SOURCES if source.unless not in present]
    return messages_of(wanted).union(*(source.joined for source in wanted))


def _instances(table: MessageTable, labels: tuple[str, ...]) -> list[tuple[int | None, MessageTable]]:
    """Split a table by its instance column; (None, table) where there is none."""
    instance = next((found for label in labels if (found := table.column(label)) is not None), None)
    if instance is None or instance.dtype.kind not in "iu":
        return [(None, table)]
    if table.n_rows and (instance == instance[0]).all():
        return [(int(instance[0]), table)]  # without a copy
    return [(int(number), table.rows(instance == number)) for number in np.unique(instance)]


def _number_in(name: str) -> int:
    """Return the number behind a message's name, 0 where there is none.

    >>> _number_in("IMU2"), _number_in("GYR")
    (2, 0)
    """
    return int(f"0{name.lstrip(string.ascii_letters)}")


def _channels(table: MessageTable) -> tuple[str, ...]:
    """Return the labels of output channels (C1, Ch1, Chan1, Mot1) in the order of their numbers."""
    found = {label: re.fullmatch(r"(?:C|Ch|Chan|Mot)(\d+)", label) for label in table.columns}
    numbers = {label: int(match[1]) for label, match in found.items() if match and table.has_numbers(label)}
    return tuple(sorted(numbers, key=numbers.__getitem__))


def _float(table: MessageTable, label: str) -> FloatArray:
    return table.columns[label].astype(np.float64)


def _scaled(values: FloatArray, factor: float) -> FloatArray:
    """Multiply in place: a copy of a long series costs more than the product."""
    if factor != 1.0:
        values *= factor
    return values


def _typical(values: AnyArray) -> float:
    """Return a large but not freak magnitude: the 99th percentile, 0 without finite values.

    Of every n-th row of a long series: what it decides is a matter of factors of ten.
    """
    some = values[:: len(values) // _ENOUGH + 1]
    finite = np.abs(some[np.isfinite(some)])
    return float(np.percentile(finite, 99.0)) if len(finite) else 0.0


def _spread(values: FloatArray | None) -> float:
    """Return the mean over columns of the deviation between the 16th and 84th percentile."""
    finite = values[np.isfinite(values).all(axis=1)] if values is not None else np.zeros(0)
    if not len(finite):
        return math.nan
    low, high = np.percentile(finite, (16.0, 84.0), axis=0)
    return float(np.mean(high - low))
