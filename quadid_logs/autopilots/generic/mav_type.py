"""MAVLink's vehicle types in the words of `vocabulary.VEHICLE_TYPES`."""

from __future__ import annotations

from typing import Final

#: MAV_TYPE of minimal.xml; PX4 logs it as the parameter MAV_TYPE and in vehicle_status.system_type.
_BY_MAV_TYPE: Final = {
    1: "fixed-wing",
    2: "multirotor",
    3: "multirotor",  # coaxial
    4: "helicopter",
    5: "tracker",
    10: "rover",
    11: "boat",
    12: "submarine",
    13: "multirotor",
    14: "multirotor",
    15: "multirotor",
    19: "vtol", 20: "vtol", 21: "vtol", 22: "vtol", 23: "vtol", 24: "vtol", 25: "vtol",
    29: "multirotor",
    35: "multirotor",
    43: "multirotor",
}  # fmt: skip

#: Words for the MAV_TYPEs that say how many rotors there are.
_FRAME_WORDS: Final = {
    2: "quadrotor", 3: "coaxial", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor",
    35: "decarotor",
}  # fmt: skip


def vehicle_type_of(mav_type: int) -> str:
    """Return the vehicle type of a MAV_TYPE, "unknown" where it says nothing about dynamics."""
    return _BY_MAV_TYPE.get(mav_type, "unknown")


def frame_words(mav_type: int) -> str:
    """Return how many rotors a MAV_TYPE has, in words; "" where it does not say."""
    return _FRAME_WORDS.get(mav_type, "")
