"""What firmware of one family shares that logs with Blackbox: frames, mixer, and the loop's rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from quadid_logs.autopilots import Autopilot
from quadid_logs.data.log import FlightLog

if TYPE_CHECKING:
    from quadid_logs.actuation.airframe import Airframe, Unknown
    from quadid_logs.actuation.motors import Rebuilt
    from quadid_logs.align.series import CleanLog


class BlackboxFamily(Autopilot):
    """An autopilot whose frame is told by its outputs."""

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """Told by the outputs: no header names the frame."""
        from quadid_logs.autopilots.betaflight.airframe import find_airframe

        return find_airframe(log)

    def rebuild(self, log: CleanLog, airframe: Airframe) -> Rebuilt:
        """Take the outputs for where the mixer's limits were reached."""
        from quadid_logs.autopilots.betaflight.torque import rebuild

        return rebuild(log, airframe)

    def angle_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:  # noqa: ARG002
        """None in modes that level the copter: their gains are scaled in ways that differ by version."""
        from quadid_logs.autopilots.betaflight.flight_modes import SELF_LEVELLING

        return None if mode in SELF_LEVELLING else (0.0, 0.0, 0.0)

    def stick_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float] | None:
        """Return those of modes that level the copter."""
        from quadid_logs.autopilots.betaflight.flight_modes import SELF_LEVELLING
        from quadid_logs.autopilots.betaflight.law import full_stick_rad_s

        return (full_stick_rad_s(parameters),) * 2 if mode in SELF_LEVELLING else None

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """Looptime of the gyro [us] times the PID's denominator."""
        from quadid_logs.autopilots.betaflight.law import loop_period_us

        period_us = loop_period_us(parameters)
        return 1e6 / period_us if period_us > 0.0 else 0.0
