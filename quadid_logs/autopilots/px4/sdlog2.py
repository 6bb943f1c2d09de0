"""PX4's legacy sdlog2 messages in canonical signals.

Fields and units: PX4 v1.0 to v1.4, src/modules/sdlog2/sdlog2_messages.h. PX4 works
in FRD and NED, in radians and SI units, so no sign or scale changes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.generic.mav_type import frame_words, vehicle_type_of
from quadid_logs.autopilots.modes import mode_changes
from quadid_logs.autopilots.px4.identity import airframe_words
from quadid_logs.autopilots.sources import Part, Source, build_signals, messages_of, plain
from quadid_logs.containers.content import message_counts
from quadid_logs.containers.dataflash import DataFlashFile, check_not_empty
from quadid_logs.containers.message_table import MessageTable, damaged_numbers_pass
from quadid_logs.containers.sdlog2 import TimeRecords
from quadid_logs.data.log import FlightLog, ModeChange, whole_number

#: ARMING_STATE_ARMED and ARMING_STATE_ARMED_ERROR of vehicle_status.msg.
_ARMED_STATES: Final = (2, 3)
#: MAIN_STATE of vehicle_status.msg, v1.0 to v1.4.
_MAIN_STATES: Final = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 6: "ACRO",
    7: "OFFBOARD", 8: "STAB", 9: "RATTITUDE",
}  # fmt: skip


def _armed(part: Part[MessageTable], source: Source[Any]) -> FloatArray | None:
    state = plain(part, source)
    return None if state is None else np.isin(state, _ARMED_STATES).astype(np.float64)


_GYRO: Final = ("GyroX", "GyroY", "GyroZ")
_ACCELEROMETER: Final = ("AccX", "AccY", "AccZ")
_ANGLES: Final = ("Roll", "Pitch", "Yaw")
_OUTPUTS: Final = tuple(f"Out{number}" for number in range(8))
SOURCES: Final[tuple[Source[Part[MessageTable]], ...]] = (
    Source("body_rate", "ATT", ("RollRate", "PitchRate", "YawRate"), "the estimator's bias-corrected rates"),
    Source("body_rate", "IMU", _GYRO, "first gyro"),
    Source("body_rate", "IMU1", _GYRO, "second gyro"),
    Source("body_rate", "IMU2", _GYRO, "third gyro"),
    Source("body_rate_setpoint", "ARSP", ("RollRateSP", "PitchRateSP", "YawRateSP"),
           "the rate controller's set-point"),
    Source("attitude", "ATT", _ANGLES, "the estimator's attitude"),
    Source("attitude_setpoint", "ATSP", ("RollSP", "PitchSP", "YawSP"),
           "the attitude controller's set-point"),
    Source("torque_command", "ATTC", _ANGLES, "the rate controller's output to the mixer"),
    Source("throttle", "ATTC", ("Thrust",), "collective command to the mixer"),
    Source("output_pwm", "OUT0", _OUTPUTS, "pulse width per output channel"),
    Source("output_pwm", "OUT1", _OUTPUTS, "pulse width per output channel, second group"),
    Source("specific_force", "IMU", _ACCELEROMETER, "first accelerometer"),
    Source("specific_force", "IMU1", _ACCELEROMETER, "second accelerometer"),
    Source("battery_voltage", "BATT", ("V",), "voltage of the battery"),
    Source("armed", "STAT", ("ArmS",), "arming state", _armed),
    Source("landed", "STAT", ("Landed",), "land detector"),
)  # fmt: skip
_LABELS: Final = frozenset({"StartTime", "Name", "Value", "FwGit", "Arch", "MainState"}).union(
    *((*source.fields, *source.optional) for source in SOURCES)
)


@damaged_numbers_pass()
def read(path: str | Path, *, system: int = 0) -> FlightLog:  # one vehicle per file
    """Read a legacy PX4 log.

    Raises
    ------
    LogNotFoundError, EmptyLogError, UnknownFormatError
        As `DataFlashFile.open` and `check_not_empty`.
    """
    with DataFlashFile.open(path) as file:
        check_not_empty(file)
        tables = file.read_messages(messages_of(SOURCES) | {"TIME", "PARM", "VER"}, _LABELS)
        ends = file.first_and_last()
    clock = TimeRecords(tables.get("TIME"))
    parameters = tables["PARM"].named_values("Name", "Value") if "PARM" in tables else {}
    mav_type = whole_number(parameters.get("MAV_TYPE"))
    commit = _text(tables.get("VER"), "FwGit")
    parts = {name: [Part(name=name, table=table, rows=clock.rows(table))] for name, table in tables.items()}
    times = {name: clock.times(table) for name, table in ends.items()}
    status = tables.get("STAT")
    modes: tuple[ModeChange, ...] = ()
    if status is not None and status.has_numbers("MainState"):
        modes = mode_changes(
            status.integers("MainState"), clock.times(status), status.position, _MAIN_STATES.get
        )
    return FlightLog(
        path=file.path,
        format="dataflash",
        dialect="sdlog2",
        autopilot="px4",
        n_bytes=file.n_bytes,
        signals=build_signals(SOURCES, lambda source: parts.get(source.message, [])),
        firmware=f"PX4 {commit[:12]}" if commit else "PX4",
        vehicle_type=vehicle_type_of(mav_type),
        frame=airframe_words(whole_number(parameters.get("SYS_AUTOSTART"))) or frame_words(mav_type),
        hardware_id=_text(tables.get("VER"), "Arch"),
        parameters=parameters,
        modes=modes,
        lost=file.lost,
        counts=message_counts(file.counts, times),
        has_time=clock.has_time,
        remarks=("Rows take the time of the TIME record before them: sdlog2 logs no other times.",),
    )


def _text(table: MessageTable | None, label: str) -> str:
    """Return a text of the first row of a message."""
    return str(table.columns[label][0]) if table is not None and table.has(label) else ""
