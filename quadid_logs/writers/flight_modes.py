"""Flight modes by name, with their numbers in each firmware.

Sources: ArduCopter/mode.h (`Mode::Number`), PX4 msg/VehicleStatus.msg
(`NAVIGATION_STATE_*`) and src/modules/commander/px4_custom_mode.h.
"""

from __future__ import annotations

from typing import Final, NamedTuple

#: Stands for a mode that the firmware does not have; log viewers show "Mode(255)".
UNKNOWN_ARDUPILOT: Final = 255


class FlightMode(NamedTuple):
    """A mode's names (the first one ArduCopter's), and its nearest relative in each firmware.

    `px4_main` and `px4_sub` make up MAVLink's custom mode.
    """

    names: tuple[str, ...]
    ardupilot: int
    nav_state: int
    px4_main: int
    px4_sub: int = 0


_MODES: Final = (
    FlightMode(("STABILIZE", "STAB", "STABILIZED"), 0, 15, 7),
    FlightMode(("ACRO",), 1, 10, 5),
    FlightMode(("ALT_HOLD", "ALTCTL", "ALTITUDE"), 2, 1, 2),
    FlightMode(("AUTO", "AUTO_MISSION", "MISSION"), 3, 3, 4, 4),
    FlightMode(("GUIDED", "OFFBOARD"), 4, 14, 6),
    FlightMode(("LOITER", "POSCTL", "POSITION"), 5, 2, 3),
    FlightMode(("RTL", "AUTO_RTL", "RETURN"), 6, 5, 4, 5),
    FlightMode(("CIRCLE", "ORBIT"), 7, 21, 3, 1),
    FlightMode(("LAND", "AUTO_LAND"), 9, 18, 4, 6),
    FlightMode(("DRIFT",), 11, 2, 3),
    FlightMode(("SPORT",), 13, 1, 2),
    FlightMode(("FLIP",), 14, 10, 5),
    FlightMode(("AUTOTUNE",), 15, 1, 2),
    FlightMode(("POSHOLD", "AUTO_LOITER", "HOLD"), 16, 4, 4, 3),
    FlightMode(("BRAKE",), 17, 4, 4, 3),
    FlightMode(("THROW",), 18, 1, 2),
    FlightMode(("AVOID_ADSB",), 19, 4, 4, 3),
    FlightMode(("GUIDED_NOGPS",), 20, 14, 6),
    FlightMode(("SMART_RTL",), 21, 5, 4, 5),
    FlightMode(("FLOWHOLD",), 22, 2, 3),
    FlightMode(("FOLLOW", "AUTO_FOLLOW_TARGET"), 23, 19, 4, 8),
    FlightMode(("ZIGZAG",), 24, 2, 3),
    FlightMode(("SYSTEMID", "SYSTEM_ID"), 25, 15, 7),
    FlightMode(("AUTOROTATE",), 26, 12, 7),
    FlightMode(("TURTLE",), 28, 10, 5),
    FlightMode(("MANUAL",), 0, 0, 1),
    FlightMode(("AUTO_TAKEOFF", "TAKEOFF"), 4, 17, 4, 2),
    FlightMode(("DESCEND",), 9, 12, 4, 6),
    FlightMode(("TERMINATION",), 0, 13, 1),
)


def _key(name: str) -> str:
    """Spell a name the one way in which names are compared."""
    return "".join(letter for letter in name.upper() if letter.isalnum())


def find_mode(name: str) -> FlightMode:
    """Return the mode of that name, in whatever spelling.

    "Mode(25)", as log viewers show a number without a name, is that number.
    Anything else unknown is ArduPilot's 255 and PX4's manual mode.
    """
    wanted = _key(name)
    for mode in _MODES:
        if wanted in map(_key, mode.names):
            return mode
    digits = wanted.removeprefix("MODE")
    if digits.isdecimal() and len(digits) <= 3:
        number = min(int(digits), UNKNOWN_ARDUPILOT)
        known = [mode for mode in _MODES if mode.ardupilot == number]
        return known[0] if known else FlightMode((name,), number, 0, 1)
    return FlightMode((name,), UNKNOWN_ARDUPILOT, 0, 1)
