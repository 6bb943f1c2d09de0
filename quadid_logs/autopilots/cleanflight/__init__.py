"""Cleanflight, and Betaflight before it named itself: Blackbox logs of 2015 to 2018, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from quadid_logs.autopilots import LogFormat
from quadid_logs.autopilots.betaflight.family import BlackboxFamily

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice


class Cleanflight(BlackboxFamily):
    """Cleanflight: no header tells which of its control laws flew, so none is modelled."""

    name = "cleanflight"
    title = "Cleanflight"

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.cleanflight.log import is_mine, read

        suffixes = (".bbl",)
        return (LogFormat("blackbox", "Cleanflight Blackbox", is_mine, read, suffixes, read_numbered=read),)

    @property
    def advice(self) -> Advice:
        """Flight mode, and choice of a log."""
        from quadid_logs.autopilots.cleanflight.advice import ADVICE

        return ADVICE


AUTOPILOT = Cleanflight()
