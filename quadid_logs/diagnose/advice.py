"""Which parameter to set on which autopilot: the only vendor names outside readers and writers."""

from __future__ import annotations

from collections.abc import Mapping

#: ArduCopter LOG_BITMASK: bit 0 is ATTITUDE_FAST, RATE and attitude at the loop rate.
_ATTITUDE_FAST = 1
_DEFAULT_LOG_BITMASK = 176126
#: PX4 SDLOG_PROFILE: default (1) + system identification (8) + high rate (16).
_SDLOG_PROFILE = 25


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
        mask = int(parameters.get("LOG_BITMASK", _DEFAULT_LOG_BITMASK)) | _ATTITUDE_FAST
        return (
            f"{onboard}Set LOG_BITMASK to {mask} (adds bit 0, ATTITUDE_FAST), so that RATE is logged at the "
            "loop rate (400 Hz), and fly again."
        )
    if autopilot == "px4":
        return (
            f"{onboard}Set SDLOG_PROFILE to {_SDLOG_PROFILE} (default + system identification + high rate), "
            "restart the vehicle, and fly again."
        )
    return f"{onboard}Log body rates and the rate controller's outputs at 100 Hz or more."


def excitation_advice(autopilot: str, axis: str) -> str:
    """Say what to fly so that an axis is moved enough."""
    system_id = {
        "ardupilot": f" ArduCopter's System ID mode does it by itself: SID_AXIS {_SID_AXIS[axis]} "
        f"(mixer {axis}), SID_MAGNITUDE {_SID_MAGNITUDE[axis]}. On the mixer axes the unit is a share of the "
        "full command, so the default of 15 is dangerous: read the value back before the flight; "
        "see quadid-log plan.",
        "px4": "",
    }.get(autopilot, "")
    stick = {"roll": "left-right", "pitch": "forward-back", "yaw": "rudder left-right"}[axis]
    return (
        f"In calm air, fly quick {stick} stick doublets (half a second each way, a third of full stick) "
        f"for 30 s.{system_id}"
    )


#: A share of the full command that moves a usual quadrotor well above its noise.
_SID_MAGNITUDE = {"roll": 0.05, "pitch": 0.05, "yaw": 0.15}
#: ArduCopter mode_systemid.cpp, SID_AXIS: 10 mixer roll, 11 mixer pitch, 12 mixer yaw.
_SID_AXIS = {"roll": 10, "pitch": 11, "yaw": 12}
