"""ArduPilot's messages as canonical signals: for each one its sources, the preferred one first.

Units and signs: libraries/AP_Logger/LogStructure.h, AC_AttitudeControl_Logging.cpp
and AP_MotorsMulticopter.cpp of ArduPilot. Body axes are FRD and angles are
right-handed throughout, as in the vocabulary; only scales differ.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.autopilots.ardupilot.clock import LogClock
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import Rows, Signal

DEGREE: Final = math.pi / 180.0
#: Full scale of the rate controller's output before ArduPilot 3.4 (ArduCopter/Parameters.cpp,
#: convert_pid_parameters: "-1 to +1 range instead of -4500 ~ +4500").
_OLD_COMMAND_SCALE: Final = 4500.0
#: The sum of PID terms is not limited and may reach 5; on the old scale it is hundreds in any flight.
_LARGEST_COMMAND: Final = 20.0
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
#: Rows that are copied at once.
_PART: Final = 1 << 12
#: ESC telemetry of one cycle lies closer together than this.
_ESC_CYCLE_S: Final = 0.5

#: What `SignalBuilder` may read at once; the PID messages are only read where RATE is missing.
MAIN_TYPES: Final = frozenset(
    {"RATE", "ANG", "ATT", "XKF1", "XKF4", "NKF1", "NKF4", "EKF1", "AHR2", "SIDD"}
    | {"IMU", "IMU2", "IMU3", "GYR", "GYR1", "GYR2", "GYR3", "ACC", "ACC1", "ACC2", "ACC3"}
    | {"RCOU", "RCO2", "RCO3", "MOT", "MOTB", "CTUN", "BAT", "CURR", "BARO", "ARM", "EV", "STAT"}
    | {"ESC", "ESC1", "ESC2", "ESC3", "ESC4", "ESC5", "ESC6", "ESC7", "ESC8"}
)
PID_TYPES: Final = frozenset({"PIDR", "PIDP", "PIDY"})


#: Every column that a signal is built from.
SIGNAL_LABELS: Final = frozenset(
    {"I", "C", "Instance", "Inst", "Id", "PI", "ArmState", "Armed", "AOut", "ThO", "ThrOut", "RPM", "Volt"}
    | {"R", "P", "Y", "RDes", "PDes", "YDes", "ROut", "POut", "YOut", "Roll", "Pitch", "Yaw"}
    | {"Rll", "Pit", "RllDes", "PitDes", "YawDes", "RllOut", "PitOut", "YawOut"}
    | {"RollDes", "PitchDes", "RollOut", "PitchOut", "Act", "Tar", "Des", "D", "FF", "DFF"}
    | {"GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ", "Gx", "Gy", "Gz", "Targ"}
    | {"BatVolt", "LiftMax", "ThLimit", "ThrAvMx", "Press", "GndTemp", "Alt", "AltAMSL"}
    | {f"{prefix}{number}" for prefix in ("C", "Ch", "Chan", "Mot") for number in range(1, 33)}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RateScale:
    """Radians per second in one count of RATE's rates, and how that is known."""

    factor: float
    unit: str
    evidence: str


class SignalBuilder:
    """Builds the sources of all canonical signals from a log's tables.

    Parameters
    ----------
    tables : mapping of str to MessageTable
        What was read of `MAIN_TYPES` and, where needed, `PID_TYPES`.
    clock : LogClock
        Gives every row its time.
    version : (int, int) or None
        Firmware version: tells the unit of RATE where nothing else does.
    """

    def __init__(
        self, tables: dict[str, MessageTable], clock: LogClock, version: tuple[int, int] | None
    ) -> None:
        self._tables = tables
        self._clock = clock
        self._old_firmware = version is not None and version < (3, 4)
        self._rate = tables.get("RATE")
        self._rate_labels = _first_labels(self._rate, _RATE_LABELS)
        self.rate_scale = self._find_rate_scale()

    def build(self) -> dict[str, tuple[Signal, ...]]:
        """Return every canonical signal that the log holds, with its sources in order of preference."""
        found = {name: tuple(sources(self)) for name, sources in _SOURCES.items()}
        return {name: signals for name, signals in found.items() if signals}

    def body_rate(self) -> Iterator[Signal]:
        """RATE, gyros, SIDD, and what the PIDs were fed with."""
        if self._rate is not None and self._rate_labels and self.rate_scale:
            yield self._signal(
                "body_rate",
                self._rate,
                self._rate_labels.measured,
                self.rate_scale.factor,
                f"the rate controller's own gyro-filtered input, in step with its output; logged in "
                f"{self.rate_scale.unit} ({self.rate_scale.evidence})",
            )
        yield from self._sensors("body_rate", "GYR", _GYRO, "gyro of sensor {}")
        yield from self._labelled(
            "body_rate",
            "SIDD",
            ("Gx", "Gy", "Gz"),
            DEGREE,
            "system-ID mode: delta angle over time, unfiltered",
        )
        actual = self._pid_sum(("Act",))
        if actual is not None:
            yield actual.as_signal("body_rate", "what the rate PIDs were fed with; RATE is missing")

    def body_rate_setpoint(self) -> Iterator[Signal]:
        """RATE's targets, else the PIDs'."""
        if self._rate is not None and self._rate_labels and self.rate_scale:
            labels = self._rate_labels.setpoint
            yield self._signal(
                "body_rate_setpoint",
                self._rate,
                labels,
                self.rate_scale.factor,
                "the rate controller's target",
            )
        target = self._pid_sum(("Tar",)) or self._pid_sum(("Des",))
        if target is not None:
            yield target.as_signal("body_rate_setpoint", "target of the rate PIDs; RATE is missing")

    def torque_command(self) -> Iterator[Signal]:
        """RATE's outputs, else the sums of the PID terms."""
        if self._rate is not None and self._rate_labels:
            labels = self._rate_labels.output
            values = _columns(self._rate, labels)
            factor, why = self._command_scale(values)
            source = _source(self._rate.name, None, labels)
            reason = f"the rate controller's output to the mixer{why}"
            yield self._made("torque_command", self._rate, _scale(values, factor), source, reason)
        terms = self._pid_sum(("P", "I", "D", "FF", "DFF"))
        if terms is not None:
            factor, why = self._command_scale(terms.values)
            yield terms.as_signal(
                "torque_command",
                f"RATE is missing: rebuilt as the sum of the PID terms, without chirp or feed-forward added "
                f"behind the PID{why}",
                factor,
            )

    def throttle(self) -> Iterator[Signal]:
        """RATE.AOut, CTUN, MOTB."""
        yield from self._labelled("throttle", "RATE", ("AOut",), 1.0, "logged with the torque command")
        for label in ("ThO", "ThrOut"):
            for signal in self._labelled(
                "throttle", "CTUN", (label,), 1.0, "output of the throttle controller"
            ):
                yield _rescaled(signal, 1e-3, "per mille") if _typical(signal.values) > 2.0 else signal
        yield from self._labelled("throttle", "MOTB", ("ThrOut",), 1.0, "throttle that reached the mixer")

    def attitude(self) -> Iterator[Signal]:
        """ANG, ATT, the EKF cores, AHR2."""
        angles = ("Roll", "Pitch", "Yaw")
        reasons = {
            "ANG": "attitude at the rate of the attitude loop",
            "ATT": "attitude that the controller used",
            "XKF1": "EKF3",
            "NKF1": "EKF2",
            "EKF1": "first EKF",
            "AHR2": "secondary attitude estimate",
        }
        for name, reason in reasons.items():
            table = self._tables.get(name)
            if table is None or not table.has(*angles):
                continue
            for core, part in self._cores(table):
                yield self._attitude(part, angles, reason if core is None else f"{reason}, core {core}", core)

    def output_pwm(self) -> Iterator[Signal]:
        """RCOU with RCO2 and RCO3; MOT of the oldest firmware."""
        parts = [self._tables[name] for name in ("RCOU", "RCO2", "RCO3") if name in self._tables]
        labelled = [(table, _channels(table)) for table in parts]
        labelled = [(table, labels) for table, labels in labelled if labels]
        if labelled:
            first = labelled[0][0]
            joined = [(table, labels) for table, labels in labelled if table.n_rows == first.n_rows]
            values = np.column_stack([_columns(table, labels) for table, labels in joined])
            source = " ".join(f"{table.name}.{labels[0]}..{labels[-1]}" for table, labels in joined)
            yield self._made("output_pwm", first, values, source, "pulse width per output channel")
        motors = self._tables.get("MOT")
        if motors is not None and (labels := _channels(motors)):
            source = f"MOT.{labels[0]}..{labels[-1]}"
            yield self._made("output_pwm", motors, _columns(motors, labels), source, "pulse width per motor")

    def rotor_speed(self) -> Iterator[Signal]:
        """ESC telemetry, unless every value is zero."""
        escs = self._esc_tables()
        if not escs:
            return
        reference = max(escs, key=lambda table: table.n_rows)
        speeds = np.column_stack([self._aligned_rpm(table, reference) for table in escs])
        if not np.any(np.nan_to_num(speeds)):
            return  # simulators and ESCs without telemetry log zeros
        yield self._made(
            "rotor_speed", reference, speeds * (math.pi / 30.0), "ESC.RPM", f"telemetry of {len(escs)} ESCs"
        )

    def specific_force(self) -> Iterator[Signal]:
        """Accelerometers, sensor by sensor."""
        yield from self._sensors("specific_force", "ACC", _ACCELEROMETER, "accelerometer of sensor {}")

    def battery_voltage(self) -> Iterator[Signal]:
        """BAT, CURR."""
        for name in ("BAT", "CURR"):
            for signal in self._labelled(
                "battery_voltage", name, ("Volt",), 1.0, "voltage of the first battery"
            ):
                if np.any(np.nan_to_num(signal.values)):
                    in_cents = _typical(signal.values) > _LARGEST_BATTERY_V
                    yield _rescaled(signal, 1e-2, "hundredths of a volt") if in_cents else signal

    def battery_ratio(self) -> Iterator[Signal]:
        """MOTB.BatVolt, which is a ratio whatever its unit says."""
        yield from self._labelled(
            "battery_ratio", "MOTB", ("BatVolt",), 1.0, "filtered voltage over MOT_BAT_VOLT_MAX"
        )

    def lift_max(self) -> Iterator[Signal]:
        """MOTB.LiftMax."""
        yield from self._labelled(
            "lift_max", "MOTB", ("LiftMax",), 1.0, "as the mixer's compensation uses it"
        )

    def throttle_limit(self) -> Iterator[Signal]:
        """MOTB.ThLimit."""
        yield from self._labelled(
            "throttle_limit", "MOTB", ("ThLimit",), 1.0, "by spool-up and battery current"
        )

    def throttle_average_max(self) -> Iterator[Signal]:
        """MOTB.ThrAvMx."""
        yield from self._labelled(
            "throttle_average_max", "MOTB", ("ThrAvMx",), 1.0, "ATC_THR_MIX_* and MOT_THST_HOVER at work"
        )

    def air_density_ratio(self) -> Iterator[Signal]:
        """BARO, as AP_Baro::get_EAS2TAS derives it: from the altitude (4.7), from the pressure (before)."""
        table = self._first_instance("BARO")
        if table is not None and table.has("AltAMSL"):
            altitude = _columns(table, ("AltAMSL",))
            yield self._made(
                "air_density_ratio",
                table,
                np.clip(1.0 - _STANDARD_LAPSE_1_M * altitude, 0.0, 2.0) ** _STANDARD_EXPONENT,
                "BARO.AltAMSL",
                "standard atmosphere 1976 at this altitude as AP_Baro::get_EAS2TAS_extended",
            )
        if table is None or not table.has("Press", "GndTemp", "Alt"):
            return
        press, ground, altitude = _columns(table, ("Press", "GndTemp", "Alt")).T
        kelvin = ground + 273.15 - _LAPSE_K_M * altitude
        ratio = np.divide(
            press, _GAS_CONSTANT * kelvin * _SEA_LEVEL_DENSITY, where=kelvin > 0.0, out=kelvin * np.nan
        )
        reason = "from pressure and ground temperature as AP_Baro::get_EAS2TAS"
        yield self._made("air_density_ratio", table, ratio[:, None], "BARO.Press GndTemp Alt", reason)

    def sysid_chirp(self) -> Iterator[Signal]:
        """SIDD.Targ."""
        yield from self._labelled("sysid_chirp", "SIDD", ("Targ",), 1.0, "chirp of the system-ID mode")

    def armed(self) -> Iterator[Signal]:
        """ARM and events 10, 11; else STAT."""
        yield from self._events("armed", {10: 1.0, 11: 0.0}, "ARM.ArmState" if "ARM" in self._tables else "")
        yield from self._labelled("armed", "STAT", ("Armed",), 1.0, "state that the vehicle repeats")

    def landed(self) -> Iterator[Signal]:
        """Events 18 and 28 (AP_Logger.h, LogEvent::LAND_COMPLETE and NOT_LANDED)."""
        yield from self._events("landed", {18: 1.0, 28: 0.0}, "")

    def _events(self, name: str, meaning: dict[int, float], extra: str) -> Iterator[Signal]:
        """Build a state from the events that change it."""
        positions: list[IntArray] = []
        values: list[FloatArray] = []
        events = self._tables.get("EV")
        if events is not None and events.has("Id"):
            ids = events.integers("Id")
            rows = np.isin(ids, list(meaning))
            positions.append(events.position[rows])
            values.append(np.array([meaning[int(number)] for number in ids[rows]], dtype=np.float64))
        if extra and self._tables["ARM"].has("ArmState"):
            positions.append(self._tables["ARM"].position)
            values.append((self._tables["ARM"].columns["ArmState"] > 0).astype(np.float64))
        if not sum(map(len, positions)):
            return
        position = np.concatenate(positions)
        order = np.argsort(position, kind="stable")
        state = np.concatenate(values)[order]
        time = self._event_times(position)[order]
        source = " ".join(filter(None, (extra, f"EV.Id {' '.join(map(str, meaning))}")))
        yield Signal(
            name=name,
            rows=Rows(time, position[order]),
            values=state[:, None],
            source=source,
            reason="changes of state",
        )

    def _event_times(self, position: IntArray) -> FloatArray:
        """Return the own time of ARM and EV rows."""
        known: dict[int, float] = {}
        for name in ("EV", "ARM"):
            if name in self._tables:
                table = self._tables[name]
                known.update(zip(table.position.tolist(), self._clock.times(table).tolist(), strict=True))
        return np.array([known[offset] for offset in position.tolist()], dtype=np.float64)

    def _find_rate_scale(self) -> RateScale | None:
        """Tell the unit of RATE: by FMTU, else against the gyro, else by the firmware's version."""
        if self._rate is None or self._rate_labels is None:
            return None
        unit = self._rate.units.get(self._rate_labels.measured[0])
        factors = {"deg/s": DEGREE, "rad/s": 1.0}
        if unit is not None and unit.label in factors:
            return RateScale(
                factor=factors[unit.label] * unit.factor, unit=unit.label, evidence="the log states the unit"
            )
        ratio = self._rate_over_gyro()
        scales = {"deg/s": DEGREE, "centidegrees/s": DEGREE / 100.0, "rad/s": 1.0}
        for name, factor in scales.items():
            if 1 / 3 < ratio * factor < 3:
                return RateScale(factor=factor, unit=name, evidence="compared with the gyro")
        old = self._rate_labels.measured[0] == "Rll" or self._old_firmware
        name = "centidegrees/s" if old else "deg/s"
        return RateScale(factor=scales[name], unit=name, evidence="assumed from the firmware's age")

    def _rate_over_gyro(self) -> float:
        """Return how many counts of RATE make one rad/s of the gyro; NaN without a moving gyro."""
        gyro = next(self._sensors("body_rate", "GYR", _GYRO, "{}"), None)
        if gyro is None or self._rate is None or self._rate_labels is None:
            return math.nan
        measured = _spread(_columns(self._rate, self._rate_labels.measured))
        reference = _spread(gyro.values)
        return measured / reference if reference > 0.0 else math.nan

    def _command_scale(self, values: FloatArray) -> tuple[float, str]:
        """Return the factor to the scale of -1 to 1, and the words for it."""
        old_rate = self.rate_scale is not None and self.rate_scale.unit == "centidegrees/s"
        if _typical(values) > _LARGEST_COMMAND or old_rate or self._old_firmware:
            return 1.0 / _OLD_COMMAND_SCALE, (
                "; divided by 4500, the full scale before firmware 3.4 (whose mixer gave roll and pitch "
                "0.71 of today's effect on X, V and H quads)"
            )
        return 1.0, ""

    def _sensors(self, name: str, single: str, labels: tuple[str, ...], reason: str) -> Iterator[Signal]:
        """Yield one signal per sensor: IMU rows of each instance, IMU2, IMU3, then raw samples."""
        for message in ("IMU", "IMU2", "IMU3", single, f"{single}1", f"{single}2", f"{single}3"):
            table = self._tables.get(message)
            if table is None or not table.has(*labels):
                continue
            for instance, part in _instances(table, ("I",)):
                number = instance if instance is not None else int(f"0{message[3:]}")
                source = _source(table.name, instance, labels)
                yield self._made(name, part, _columns(part, labels), source, reason.format(number))

    def _cores(self, table: MessageTable) -> list[tuple[int | None, MessageTable]]:
        """Split an EKF message by core, the one that was primary most of the time first."""
        cores = _instances(table, ("C",))
        status = self._tables.get(table.name.replace("F1", "F4"))
        if len(cores) < 2 or status is None or not status.has("PI"):
            return cores
        primary = status.integers("PI")
        most = max((core[0] or 0 for core in cores), key=lambda core: np.count_nonzero(primary == core))
        return sorted(cores, key=lambda core: (core[0] != most, core[0]))

    def _attitude(
        self, table: MessageTable, labels: tuple[str, ...], reason: str, core: int | None
    ) -> Signal:
        """Turn degrees with yaw from 0 to 360 into radians with yaw from -pi to pi."""
        values = _columns(table, labels, DEGREE)
        values[values[:, 2] > math.pi, 2] -= 2.0 * math.pi
        return self._made("attitude", table, values, _source(table.name, core, labels), reason)

    def _esc_tables(self) -> list[MessageTable]:
        """Return one table per ESC, in the order of their numbers."""
        table = self._tables.get("ESC")
        if table is not None and table.has("RPM"):
            return [part for _, part in _instances(table, ("Instance", "I", "Id"))]
        single = [self._tables.get(f"ESC{number}") for number in range(1, 9)]
        return [table for table in single if table is not None and table.has("RPM")]

    def _aligned_rpm(self, table: MessageTable, reference: MessageTable) -> FloatArray:
        """Return an ESC's speed in the logging cycle of each reference row, NaN where it is silent."""
        rpm = np.abs(table.columns["RPM"].astype(np.float64))
        if table is reference:
            return rpm
        next_cycle = np.append(reference.position[1:], np.iinfo(np.int64).max)
        row = np.searchsorted(table.position, next_cycle, side="left") - 1
        age = self._clock.times(reference) - self._clock.times(table)[np.maximum(row, 0)]
        return np.where((row >= 0) & (np.abs(age) < _ESC_CYCLE_S), rpm[np.maximum(row, 0)], np.nan)

    def _first_instance(self, name: str) -> MessageTable | None:
        """Return the rows of the first sensor of a message type."""
        table = self._tables.get(name)
        return None if table is None else _instances(table, ("I", "Instance", "Inst"))[0][1]

    def _labelled(
        self, name: str, message: str, labels: tuple[str, ...], factor: float, reason: str
    ) -> Iterator[Signal]:
        """Yield the signal of some columns of a message type, if they exist."""
        table = self._first_instance(message)
        if table is not None and table.has(*labels):
            yield self._signal(name, table, labels, factor, reason)

    def _pid_sum(self, labels: tuple[str, ...]) -> _PidSum | None:
        """Sum terms of PIDR, PIDP and PIDY, row by row of the same loop."""
        tables = [self._tables.get(name) for name in ("PIDR", "PIDP", "PIDY")]
        if "RATE" in self._tables or any(t is None or not t.has(labels[0]) for t in tables):
            return None
        present = [table for table in tables if table is not None]
        rows = _same_loop([table.position for table in present])
        terms = [
            sum(
                (table.columns[label][row].astype(np.float64) for label in labels if table.has(label)),
                np.zeros(len(row)),
            )
            for table, row in zip(present, rows, strict=True)
        ]
        first = present[0].rows(rows[0])
        names = "+".join(label for label in labels if present[0].has(label))
        return _PidSum(
            time_s=self._clock.times(first),
            values=np.column_stack(terms),
            position=first.position,
            source=f"PIDR PIDP PIDY {names}",
        )

    def _signal(
        self, name: str, table: MessageTable, labels: Sequence[str], factor: float, reason: str
    ) -> Signal:
        """Build a signal from columns of a table times a factor."""
        return self._made(
            name, table, _columns(table, labels, factor), _source(table.name, None, labels), reason
        )

    def _made(self, name: str, table: MessageTable, values: FloatArray, source: str, reason: str) -> Signal:
        """Build a signal from values in its unit and the rows that they come from."""
        return Signal(
            name=name,
            rows=Rows(self._clock.times(table), table.position),
            values=values,
            source=source,
            reason=reason,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _RateLabels:
    """The columns of RATE in one age of the firmware."""

    measured: tuple[str, str, str]
    setpoint: tuple[str, str, str]
    output: tuple[str, str, str]


#: Since 3.3, and before.
_RATE_LABELS: Final = (
    _RateLabels(measured=("R", "P", "Y"), setpoint=("RDes", "PDes", "YDes"), output=("ROut", "POut", "YOut")),
    _RateLabels(
        measured=("Rll", "Pit", "Yaw"),
        setpoint=("RllDes", "PitDes", "YawDes"),
        output=("RllOut", "PitOut", "YawOut"),
    ),
    _RateLabels(
        measured=("Roll", "Pitch", "Yaw"),
        setpoint=("RollDes", "PitchDes", "YawDes"),
        output=("RollOut", "PitchOut", "YawOut"),
    ),
)
_GYRO: Final = ("GyrX", "GyrY", "GyrZ")
_ACCELEROMETER: Final = ("AccX", "AccY", "AccZ")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PidSum:
    """Terms of the three rate PIDs, summed."""

    time_s: FloatArray
    values: FloatArray
    position: IntArray
    source: str

    def as_signal(self, name: str, reason: str, factor: float = 1.0) -> Signal:
        """Scale and name the sum."""
        return Signal(
            name=name,
            rows=Rows(self.time_s, self.position),
            values=self.values * factor,
            source=self.source,
            reason=reason,
        )


_SOURCES: Final[dict[str, Callable[[SignalBuilder], Iterator[Signal]]]] = {
    "body_rate": SignalBuilder.body_rate,
    "body_rate_setpoint": SignalBuilder.body_rate_setpoint,
    "attitude": SignalBuilder.attitude,
    "torque_command": SignalBuilder.torque_command,
    "throttle": SignalBuilder.throttle,
    "output_pwm": SignalBuilder.output_pwm,
    "rotor_speed": SignalBuilder.rotor_speed,
    "specific_force": SignalBuilder.specific_force,
    "battery_voltage": SignalBuilder.battery_voltage,
    "battery_ratio": SignalBuilder.battery_ratio,
    "lift_max": SignalBuilder.lift_max,
    "throttle_limit": SignalBuilder.throttle_limit,
    "throttle_average_max": SignalBuilder.throttle_average_max,
    "air_density_ratio": SignalBuilder.air_density_ratio,
    "armed": SignalBuilder.armed,
    "landed": SignalBuilder.landed,
    "sysid_chirp": SignalBuilder.sysid_chirp,
}


def _first_labels(table: MessageTable | None, choices: tuple[_RateLabels, ...]) -> _RateLabels | None:
    """Return the first set of labels that a table has in full."""
    if table is None:
        return None
    return next((each for each in choices if table.has(*each.measured, *each.setpoint, *each.output)), None)


def _columns(table: MessageTable, labels: Sequence[str], factor: float = 1.0) -> FloatArray:
    """Stack columns of numbers times a factor, shape (n_rows, n_labels)."""
    stacked = np.empty((table.n_rows, len(labels)))
    # In parts, which stay in the processor's cache from column to column.
    for first in range(0, table.n_rows, _PART):
        part = slice(first, first + _PART)
        for number, label in enumerate(labels):
            stacked[part, number] = table.columns[label][part]
        _scale(stacked[part], factor)
    return stacked


def _scale(values: FloatArray, factor: float) -> FloatArray:
    """Multiply in place: a copy of a long series costs more than the product."""
    if factor != 1.0:
        values *= factor
    return values


def _instances(table: MessageTable, labels: Sequence[str]) -> list[tuple[int | None, MessageTable]]:
    """Split a table by its instance column; (None, table) where there is none."""
    label = next((label for label in labels if label in table.columns), None)
    if label is None or table.columns[label].dtype.kind not in "iu":
        return [(None, table)]
    instance = table.columns[label]
    if table.n_rows and (instance == instance[0]).all():
        return [(int(instance[0]), table)]  # without a copy
    return [(int(number), table.rows(instance == number)) for number in np.unique(instance)]


def _channels(table: MessageTable) -> tuple[str, ...]:
    """Return the labels of output channels (C1, Ch1, Chan1, Mot1) in the order of their numbers."""
    found = {label: re.fullmatch(r"(?:C|Ch|Chan|Mot)(\d+)", label) for label in table.columns}
    numbers = {label: int(match[1]) for label, match in found.items() if match}
    return tuple(sorted(numbers, key=numbers.__getitem__))


def _source(message: str, instance: int | None, labels: Sequence[str]) -> str:
    """Name a message's columns for the reader of the report: ``IMU[0].GyrX GyrY GyrZ``."""
    return f"{message}{'' if instance is None else f'[{instance}]'}.{' '.join(labels)}"


def _rescaled(signal: Signal, factor: float, unit: str) -> Signal:
    """Return a signal times a factor, and say so."""
    return Signal(
        name=signal.name,
        rows=signal.rows,
        values=signal.values * factor,
        source=signal.source,
        reason=f"{signal.reason}; logged in {unit}",
    )


def _typical(values: AnyArray) -> float:
    """Return a large but not freak magnitude: the 99th percentile, 0 without finite values.

    Of every n-th row of a long series: what it decides is a matter of factors of ten.
    """
    some = values[:: len(values) // _ENOUGH + 1]
    finite = np.abs(some[np.isfinite(some)])
    return float(np.percentile(finite, 99.0)) if len(finite) else 0.0


def _spread(values: FloatArray) -> float:
    """Return the mean over columns of the deviation between the 16th and 84th percentile."""
    finite = values[np.isfinite(values).all(axis=1)]
    if not len(finite):
        return math.nan
    low, high = np.percentile(finite, (16.0, 84.0), axis=0)
    return float(np.mean(high - low))


def _same_loop(positions: list[IntArray]) -> list[IntArray]:
    """Match rows of messages that each loop logs one after the other: R, P, Y without R between."""
    first = positions[0]
    following = np.append(first[1:], np.iinfo(np.int64).max)
    rows = [np.searchsorted(other, first) for other in positions[1:]]
    complete = np.ones(len(first), np.bool_)
    for other, row in zip(positions[1:], rows, strict=True):
        inside = np.minimum(row, len(other) - 1)
        complete &= (row < len(other)) & (other[inside] < following)
    return [np.flatnonzero(complete), *(row[complete] for row in rows)]
