"""Crazyflie: micro-SD logs of its log variables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from quadid_logs.autopilots import Autopilot, LogFormat, entry

if TYPE_CHECKING:
    from quadid_logs.actuation.airframe import Airframe, Unknown
    from quadid_logs.data.log import FlightLog

#: ATTITUDE_RATE of the firmware's stabilizer_types.h [Hz]: all of its controllers make torque so often.
_ATTITUDE_RATE_HZ = 500.0


class Crazyflie(Autopilot):
    """Bitcraze's Crazyflie; the laws of its controllers are not modelled, and its logs hold no parameters."""

    name = "crazyflie"
    title = "Crazyflie"
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """Tell logs of the micro-SD deck by their first bytes: they have no suffix."""
        from quadid_logs.autopilots.crazyflie.log import read
        from quadid_logs.containers.usd import is_mine

        return (LogFormat("usd", "Crazyflie micro-SD log", is_mine, read, (".usd",)),)

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """Say that neither the frame nor its motors are in the log."""
        from quadid_logs.actuation.airframe import Unknown

        return Unknown(
            remark="The log does not say which motors and propellers flew, so its torque is a command."
        )

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """Return the rate at which every controller of the firmware makes torque."""
        return _ATTITUDE_RATE_HZ


AUTOPILOT = Crazyflie()
