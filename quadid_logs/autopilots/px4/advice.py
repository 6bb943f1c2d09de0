"""What to log, set and fly with PX4, by the version of the firmware."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from quadid_logs.autopilots.generic.advice import Advice, Version
from quadid_logs.autopilots.px4.offboard import (
    FAILSAFES,
    MOST_HZ,
    PARAMETERS,
    PARAMETERS_BACK,
    SCRIPT,
    offboard_script,
)
from quadid_logs.data.log import whole_number

#: Integers (imu_gyro_parameters.c, logger/params.c, commander_params.c): files of QGroundControl name types.
_INTEGERS: Final = frozenset(
    {"IMU_GYRO_DNF_EN", "IMU_GYRO_DNF_HMC", "SDLOG_PROFILE", "COM_OBL_RC_ACT", "COM_RC_OVERRIDE"}
)
#: Bits of SDLOG_PROFILE (src/modules/logger/params.c): default, system identification, high rate.
_PROFILE: Final = 1 | 8 | 16
#: Before, SDLOG_PROFILE was no bitmask or did not exist.
_BITMASK_SINCE: Final[Version] = (1, 8)
#: Topics of a log for `quadid-log live`, with the shortest interval [ms]
#: (src/modules/logger/logged_topics.cpp, `add_topics_from_file`).
_LIVE_TOPICS: Final = (
    "vehicle_angular_velocity 4",
    "vehicle_rates_setpoint 4",
    "vehicle_torque_setpoint 4",
    "vehicle_thrust_setpoint 4",
    "actuator_motors 4",
    "vehicle_attitude 10",
    "vehicle_status",
    "vehicle_land_detected",
    "battery_status 200",
)


class Px4Advice(Advice):
    """SDLOG_PROFILE, stick doublets, and QGroundControl's parameter files."""

    remedies = MappingProxyType(
        {
            "QL308": (
                "Give mass_kg, arm_length_m and torque_to_thrust_m in --vehicle FILE.toml. CA_ROTORn_PX, "
                "PY, CT and KM do not describe the vehicle while they have their defaults (arms of 1 m, CT "
                "6.5, KM 0.05)."
            ),
            "QL310": "Check SENS_BOARD_ROT and the rotations of the sensors.",
        }
    )
    logging_settings = (("SDLOG_PROFILE", float(_PROFILE)),)
    logging_bits = MappingProxyType({"SDLOG_PROFILE": _PROFILE})
    logging_note = "restart the vehicle afterwards"
    unknown_mask_note = (
        "the default with bits 3 and 4 (system identification and high rate) added; if your value is not "
        "1, do not load the file, but add both bits to your value"
    )
    live_note = (
        "set SDLOG_BACKEND = 3 (card and MAVLink, the default); use a link of about 180 kB/s, such as USB "
        "or Wi-Fi; about 50 kB/s are enough with logger_topics.txt in etc/logging on the card, which "
        "replaces the profile until you remove it"
    )
    not_set_by_hand = ("CAL_*", "LND_FLIGHT_T_*", "COM_FLIGHT_UUID")
    excitation_entry = "rate"
    excitation_by = "excite.py"
    excitation_most_hz = MOST_HZ
    gyro_filter_parameter = "IMU_GYRO_CUTOFF"
    hover_mode = "Stabilized or Altitude mode"
    parameter_suffix = ".params"
    columns = ("", "Vehicle-Id Component-Id Name Value Type")

    def live_files(self, parameters: Mapping[str, float]) -> dict[str, str]:
        """Return the topics that an estimate needs; see `Advice.live_files`."""
        return {"logger_topics.txt": "".join(f"{topic}\n" for topic in _LIVE_TOPICS)}

    def excitation_files(
        self,
        excitations: Mapping[str, Mapping[str, float]],
        multisine: Mapping[str, Any],
        parameters: Mapping[str, float],
    ) -> dict[str, str]:
        """Return the script that moves all axes off-board, and the failsafes that it asks for."""
        if not excitations:
            return {}
        known = tuple((name, parameters[name]) for name in FAILSAFES if name in parameters)
        files = {
            SCRIPT: offboard_script(multisine),
            PARAMETERS: self.parameter_text(
                "Leave Offboard when its set-points end; the sticks also end it",
                tuple(FAILSAFES.items()),
                parameters,
            ),
        }
        if known:
            files[PARAMETERS_BACK] = self.parameter_text("Failsafes as before", known, parameters)
        return files

    @property
    def excitation_step(self) -> str:
        """The script, where there is a link to a computer."""
        return (
            f"With a computer on MAVLink, {SCRIPT} can replace the doublets. Load {PARAMETERS}, hover in "
            f"Position mode 10 m high, run `python {SCRIPT} ADDRESS`, and switch to Offboard when it says "
            "so. Another mode, the sticks, or Ctrl-C end it."
        )

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say what to do about SDLOG_PROFILE; the old logger's files are of DataFlash's framing."""
        # sdlog2 writes DataFlash; a ULog holds all parameters, so that one without this knows no profile.
        unknown = version is None and bool(parameters) and "SDLOG_PROFILE" not in parameters
        old = log_format == "dataflash" or (log_format == "ulog" and unknown)
        if limit := "; ".join(self.version_notes((0,) if old else version)):
            return f"{limit} Then set SDLOG_PROFILE to {_PROFILE} and fly again."
        profile = whole_number(parameters.get("SDLOG_PROFILE"), 1)
        if profile & _PROFILE == _PROFILE:
            return (
                f"SDLOG_PROFILE is {profile}, so rates and torque are logged at a high rate. If rows are "
                "missing, the card did not keep up: use a faster one, or log fewer topics."
            )
        kept = "; the others as they are" if profile & ~_PROFILE else ""
        return (
            f"Set SDLOG_PROFILE to {profile | _PROFILE} (default + system identification + high rate{kept}), "
            "restart the vehicle, and fly again."
        )

    def version_notes(self, version: Version | None) -> tuple[str, ...]:
        """Return that an old logger has no profile of high rates."""
        if version is None or version >= _BITMASK_SINCE:
            return ()
        return ("PX4 before 1.8 has no logging profile with a high rate. Update the firmware.",)

    def parameter_line(self, name: str, value: str, parameters: Mapping[str, float]) -> str:
        """Return QGroundControl's columns; for this vehicle, type 9: single precision, 6: an integer."""
        vehicle = whole_number(parameters.get("MAV_SYS_ID"), 1)
        return f"{vehicle}\t1\t{name}\t{value}\t{6 if name in _INTEGERS else 9}"


ADVICE: Final = Px4Advice()
