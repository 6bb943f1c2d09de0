"""The script that excites a PX4 vehicle by rate set-points, and the failsafes that it needs.

The script's body is `excite.py.txt` beside this file; what differs from plan to plan is put into it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from types import MappingProxyType
from typing import Any, Final

SCRIPT: Final = "excite.py"
PARAMETERS: Final = "offboard.params"
PARAMETERS_BACK: Final = "offboard-back.params"
#: Streams of MAVLink bring set-points at 50 Hz with some ms of jitter: ten of them to a cycle.
MOST_HZ: Final = 5.0
#: src/modules/commander/commander_params.c. Half a second without set-points ends Offboard; what comes then
#: is Position mode (0); the sticks end it, too (bit 1).
FAILSAFES: Final[Mapping[str, float]] = MappingProxyType(
    {"COM_OF_LOSS_T": 0.5, "COM_OBL_RC_ACT": 0.0, "COM_RC_OVERRIDE": 3.0}
)
_LIMITS: Final[Mapping[str, float]] = MappingProxyType(
    {"MOST_TILT_DEG": 30, "LEAST_HEIGHT_M": 4, "MOST_CLIMB_M": 4, "LEAST_BATTERY_PERCENT": 30}
)
_HERE: Final = "# The settings of the plan stand above this line.\n"


def offboard_script(multisine: Mapping[str, Any]) -> str:
    """Return the script of a flight.

    Parameters
    ----------
    multisine : mapping
        As of `quadid_logs.autopilots.ardupilot.flight_script.flight_script`.
    """
    body = resources.files(__package__).joinpath(f"{SCRIPT}.txt").read_text(encoding="utf-8")
    settings = [
        *(f"{name} = {value:g}" for name, value in _LIMITS.items()),
        f"FAILSAFES = {dict(FAILSAFES)!r}",
        f"MULTISINE = {dict(multisine)!r}",
    ]
    return body.replace(_HERE, "\n".join(settings) + "\n")
