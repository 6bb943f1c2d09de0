"""Which parameter to set on which autopilot: the only vendor names outside readers and writers."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from quadid_logs.data.log import whole_number

#: ArduCopter LOG_BITMASK: bit 0 is ATTITUDE_FAST, RATE and attitude at the loop rate.
ATTITUDE_FAST: Final = 1
DEFAULT_LOG_BITMASK: Final = 176126
#: PX4 SDLOG_PROFILE: default (1) + system identification (8) + high rate (16).
SDLOG_PROFILE: Final = 25
#: ArduCopter mode_systemid.cpp, SID_AXIS: 10 mixer roll, 11 mixer pitch, 12 mixer yaw.
SID_AXIS: Final[Mapping[str, int]] = MappingProxyType({"roll": 10, "pitch": 11, "yaw": 12})
#: Share of the mixer's range. Rolls and pitches a quadrotor by some 30 deg/s at 1 Hz and by little at
#: 8 Hz; yaw answers ten times less. Too small for the noise is seen, too large meets the motors' limits.
SID_MAGNITUDE: Final[Mapping[str, float]] = MappingProxyType({"roll": 0.05, "pitch": 0.05, "yaw": 0.15})
#: How a pilot moves the stick of an axis.
STICKS: Final[Mapping[str, str]] = MappingProxyType(
    {"roll": "left-right", "pitch": "forward-back", "yaw": "rudder left-right"}
)


def logging_advice(autopilot: str, log_format: str, parameters: Mapping[str, float]) -> str:
    """Say what to set so that rates and torque are logged at the loop rate.

    Parameters
    ----------
    autopilot, log_format : str
        As in `FlightLog`.
    parameters : mapping of str to float
        Of the log; a bitmask found there is kept and added to.
    """
    if log_format == "table":
        return "Export the table with at least 100 rows per second."
    onboard = ""
    if log_format == "tlog":
        onboard = (
            "A telemetry log is too slow for this and lacks the torque: use the log on the vehicle's card. "
        )
    if autopilot == "ardupilot":
        mask = whole_number(parameters.get("LOG_BITMASK"), DEFAULT_LOG_BITMASK) | ATTITUDE_FAST
        return (
            f"{onboard}Set LOG_BITMASK to {mask} (adds bit 0, ATTITUDE_FAST), so that RATE is logged at the "
            "loop rate (400 Hz), and fly again."
        )
    if autopilot == "px4":
        return (
            f"{onboard}Set SDLOG_PROFILE to {SDLOG_PROFILE} (default + system identification + high rate), "
            "restart the vehicle, and fly again."
        )
    return f"{onboard}Log body rates and the rate controller's outputs at 100 Hz or more."


def excitation_advice(autopilot: str, axis: str) -> str:
    """Say what to fly so that an axis is moved enough."""
    system_id = {
        "ardupilot": f" ArduCopter's System ID mode does it by itself: SID_AXIS {SID_AXIS[axis]} "
        f"(mixer {axis}), SID_MAGNITUDE {SID_MAGNITUDE[axis]}. On the mixer axes the unit is a share of the "
        "full command, so the default of 15 is dangerous: read the value back before the flight; "
        "see quadid-log plan.",
        "px4": "",
    }.get(autopilot, "")
    return (
        f"In calm air, fly quick {STICKS[axis]} stick doublets (half a second each way, a third of full "
        f"stick) for 30 s.{system_id}"
    )
