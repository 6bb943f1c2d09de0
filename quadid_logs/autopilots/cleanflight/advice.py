"""What to log and fly with Cleanflight."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from quadid_logs.autopilots.generic.advice import Advice


class CleanflightAdvice(Advice):
    """Nothing that its command line could be told: its logs hold what they hold."""

    hover_mode = "Angle or Acro mode"
    remedies = MappingProxyType(
        {
            "QL321": (
                "Fly in Acro mode. Cleanflight logs no rate set-points, and they follow from the sticks in "
                "Acro mode only."
            ),
            "QL401": (
                "Use a log with a flight of at least half a minute. If the file holds several logs, "
                "`quadid-log info LOG` lists them and --log N chooses one. If you did fly, fetch the whole "
                "file again."
            ),
        }
    )


ADVICE: Final = CleanflightAdvice()
