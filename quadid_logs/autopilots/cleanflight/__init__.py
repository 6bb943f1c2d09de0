"""Cleanflight, and Betaflight before it named itself: Blackbox logs of 2015 to 2018, and nothing else."""

from __future__ import annotations

from quadid_logs.autopilots import LogFormat, entry
from quadid_logs.autopilots.betaflight import BlackboxFamily


class Cleanflight(BlackboxFamily):
    """Cleanflight: no header tells which of its control laws flew, so none is modelled."""

    name = "cleanflight"
    title = "Cleanflight"
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.cleanflight.log import DIALECT, read

        title = "Cleanflight Blackbox"
        return (LogFormat("blackbox", title, DIALECT.is_mine, read, (".bbl",), read_numbered=read),)


AUTOPILOT = Cleanflight()
