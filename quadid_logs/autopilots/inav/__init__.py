"""INAV: its Blackbox fields, and nothing else; frames, mixer and format are those of its family."""

from __future__ import annotations

from typing import TYPE_CHECKING

from quadid_logs.autopilots import LogFormat
from quadid_logs.autopilots.betaflight.family import BlackboxFamily

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice


class Inav(BlackboxFamily):
    """INAV on multirotors; the law of its loops is not modelled."""

    name = "inav"
    title = "INAV"

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.inav.log import is_mine, read

        return (LogFormat("blackbox", "INAV Blackbox", is_mine, read, (".bbl",), read_numbered=read),)

    @property
    def advice(self) -> Advice:
        """Blackbox rate."""
        from quadid_logs.autopilots.inav.advice import ADVICE

        return ADVICE


AUTOPILOT = Inav()
