"""Betaflight and its family: Blackbox fields, settings and mixer, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping

from quadid_logs.autopilots import Autopilot, LogFormat, entry


class BlackboxFamily(Autopilot):
    """An autopilot that logs with Blackbox: no header names its frame, which its outputs tell."""

    find_airframe = entry(f"{__name__}.airframe:find_airframe")
    rebuild = entry(f"{__name__}.torque:rebuild")

    def angle_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
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


class Betaflight(BlackboxFamily):
    """Betaflight of every version."""

    name = "betaflight"
    title = "Betaflight"

    thrust_law = entry(f"{__name__}.mixer:thrust_law")
    controllers = entry(f"{__name__}.controller:controllers")
    replay_inputs = entry(f"{__name__}.replay:replay_inputs")
    tunable = entry(f"{__name__}.gains:tunable")
    filter_choices = entry(f"{__name__}.filter_choices:filter_choices")
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.betaflight.log import read
        from quadid_logs.containers import blackbox

        suffixes = (".bbl", ".bfl")
        title = "Betaflight Blackbox"
        return (
            LogFormat(
                "blackbox",
                title,
                blackbox.is_mine,
                read,
                suffixes,
                read_numbered=read,
                shared_suffixes=(".txt",),
            ),
        )


AUTOPILOT = Betaflight()
