"""One Lua script that flies all sweeps of a plan in one flight, and puts every parameter back.

The script's body is `excite.lua` beside this file; what differs from plan to plan stands above it as a table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from types import MappingProxyType
from typing import Final

SCRIPT: Final = "excite.lua"
#: RCx_OPTION 300, Scripting1 (RC_Channel.h, AUX_FUNC).
SWITCH: Final = 300
#: What ends the test. Tilt: twice what a sweep and its gusts make of the attitude. Height: room to recover
#: below, and what a fence allows above. Battery: as much is left as a landing with half of the flight's wind
#: needs.
_LIMITS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "MOST_TILT_DEG": 30,
        "LEAST_HEIGHT_M": 4,
        "MOST_HEIGHT_M": 60,
        "MOST_CLIMB_M": 6,
        "LEAST_BATTERY_PERCENT": 30,
    }
)


def flight_script(sweeps: Sequence[Mapping[str, object]], multisine: Mapping[str, object]) -> str:
    """Return the script of a flight.

    Parameters
    ----------
    sweeps : sequence of mapping
        In the order of flying: SID_* by name, ``name`` of the axis, and ``limit`` of SID_MAGNITUDE.
    multisine : mapping
        ``period_s``, ``periods``; by axis ``lines`` of frequency [Hz] and phase [rad], ``scale_dps`` of each
        line and ``limit_dps`` of their sum.
    """
    values = {"SWITCH": SWITCH, **_LIMITS}
    lines = [
        "-- excite.lua: the sweeps of one flight plan. Copy it into APM/scripts on the card, set",
        f"-- SCR_ENABLE = 1 and RCx_OPTION = {SWITCH} (Scripting1) of a free switch, and restart the "
        "autopilot.",
        *(f"local {name} = {_lua(value)}" for name, value in values.items()),
        "-- The multisine moves all axes at once in Guided mode, with rate targets. It is flown if this is "
        "true.",
        "local FLY_MULTISINE = false",
        f"local SWEEPS = {_lua(list(sweeps))}",
        f"local MULTISINE = {_lua(multisine)}",
        "",
    ]
    return "\n".join(lines) + resources.files(__package__).joinpath(SCRIPT).read_text(encoding="utf-8")


def _lua(value: object) -> str:
    """Return a value as Lua writes it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_lua(each)}" for name, each in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "{ " + ", ".join(_lua(each) for each in value) + " }"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:.7g}"
