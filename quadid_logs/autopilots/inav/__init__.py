"""INAV: its Blackbox fields, and nothing else; frames, mixer and format are those of its family."""

from __future__ import annotations

from quadid_logs.autopilots import LogFormat, entry
from quadid_logs.autopilots.betaflight import BlackboxFamily


class Inav(BlackboxFamily):
    """INAV on multirotors; the law of its loops is not modelled."""

    name = "inav"
    title = "INAV"
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.inav.log import DIALECT, read

        title = "INAV Blackbox"
        return (LogFormat("blackbox", title, DIALECT.is_mine, read, (".bbl",), read_numbered=read),)


AUTOPILOT = Inav()
