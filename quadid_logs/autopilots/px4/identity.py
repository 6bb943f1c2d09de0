"""What flew: firmware, vehicle type, frame and flight modes in PX4's words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.autopilots.generic.mav_type import frame_words, vehicle_type_of
from quadid_logs.counting import counted
from quadid_logs.data.log import whole_number

#: First number of each thousand in ROMFS/px4fmu_common/init.d/airframes.
_BY_THOUSAND: Final = {
    4: "quad X", 5: "quad +", 6: "hexa X", 7: "hexa +", 8: "octa X", 9: "octa +",
    11: "hexa coaxial", 12: "octo coaxial", 14: "tricopter",
}  # fmt: skip
_NAV_STATES: Final = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL",
    6: "POSITION_SLOW", 8: "ALTITUDE_CRUISE", 10: "ACRO", 12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD",
    15: "STABILIZED", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND", 19: "AUTO_FOLLOW_TARGET", 20: "AUTO_PRECLAND",
    21: "ORBIT", 22: "AUTO_VTOL_TAKEOFF", 23: "EXTERNAL1", 24: "EXTERNAL2", 25: "EXTERNAL3", 26: "EXTERNAL4",
    27: "EXTERNAL5", 28: "EXTERNAL6", 29: "EXTERNAL7", 30: "EXTERNAL8",
}  # fmt: skip
#: The same numbers meant something else before 1.14 (msg/vehicle_status.msg).
_OLD_NAV_STATES: Final = {
    6: "AUTO_RCRECOVER", 7: "AUTO_RTGS", 8: "AUTO_LANDENGFAIL", 9: "AUTO_LANDGPSFAIL", 16: "RATTITUDE",
}  # fmt: skip
_RENUMBERED_AT: Final = (1, 14)

#: CA_AIRFRAME of src/modules/control_allocator/module.yaml.
_BY_CA_AIRFRAME: Final = {
    0: "multirotor", 1: "fixed-wing", 2: "vtol", 3: "vtol", 4: "vtol", 5: "rover", 6: "rover",
    7: "submarine", 8: "multirotor", 10: "helicopter", 11: "helicopter", 12: "helicopter", 13: "rover",
}  # fmt: skip
#: VEHICLE_TYPE_* of msg/VehicleStatus.msg, since 1.10.
_BY_STATUS: Final = {1: "multirotor", 2: "fixed-wing", 3: "rover"}

Version = tuple[int, int, int, int]


def airframe_words(sys_autostart: int) -> str:
    """Return the frame of an airframe number (SYS_AUTOSTART), "" where its thousand says nothing."""
    return _BY_THOUSAND.get(sys_autostart // 1000, "")


def version_of(information: Mapping[str, object]) -> Version | None:
    """Return major, minor, patch and type of ver_sw_release (src/lib/version/version.c)."""
    release = information.get("ver_sw_release")
    if not isinstance(release, int) or release <= 0:
        return None
    return release >> 24 & 0xFF, release >> 16 & 0xFF, release >> 8 & 0xFF, release & 0xFF


def firmware_words(information: Mapping[str, object]) -> str:
    """Return name, version and git hash as far as they are logged."""
    words = [str(information.get("sys_name", "PX4"))]
    version = version_of(information)
    if version is not None:
        major, minor, patch, kind = version
        suffix = {0: "-dev", 1: "-alpha", 2: "-beta", 3: "-rc"}[kind // 64] if kind != 255 else ""
        words.append(f"v{major}.{minor}.{patch}{suffix}")
    if information.get("ver_sw"):
        words.append(f"({str(information['ver_sw'])[:8]})")
    return " ".join(words)


def n_cells(parameters: Mapping[str, float]) -> int:
    """Return how many cells the battery has by the parameters, 0 where they do not say."""
    stated = (whole_number(parameters.get(name)) for name in ("BAT1_N_CELLS", "BAT_N_CELLS"))
    return next((one for one in stated if one > 0), 0)


def vehicle_type(parameters: Mapping[str, float], status: Mapping[str, int]) -> str:
    """Ask what says most first: VTOL flag, MAV_TYPE, control allocation, status.

    Parameters
    ----------
    status : mapping of str to int
        Last values of vehicle_status.
    """
    if status.get("is_vtol"):
        return "vtol"
    mav_types = whole_number(parameters.get("MAV_TYPE")), status.get("system_type", 0)
    answers = [vehicle_type_of(mav_type) for mav_type in mav_types]
    if "CA_AIRFRAME" in parameters and parameters.get("CA_ROTOR_COUNT", 0):
        answers.append(_BY_CA_AIRFRAME.get(whole_number(parameters["CA_AIRFRAME"], -1), "unknown"))
    answers.append(_BY_STATUS.get(status.get("vehicle_type", 0), "unknown"))
    return next((answer for answer in answers if answer != "unknown"), "unknown")


def describe_frame(parameters: Mapping[str, float]) -> str:
    """Say rotors and geometry in words, from CA_ROTOR*, else from airframe number and MAV_TYPE."""
    n_rotors = whole_number(parameters.get("CA_ROTOR_COUNT"))
    airframe = whole_number(parameters.get("SYS_AUTOSTART"))
    words = [airframe_words(airframe) or frame_words(whole_number(parameters.get("MAV_TYPE")))]
    if airframe:
        words.append(f"airframe {airframe}")
    if 0 < n_rotors <= 12:
        words.append(f"{counted(n_rotors, 'rotor')}{_layout(parameters, n_rotors)} in CA_ROTOR*")
    return ", ".join(word for word in words if word)


def _layout(parameters: Mapping[str, float], n_rotors: int) -> str:
    """Tell whether the rotors stand in pairs above each other, or on the axes, by CA_ROTORn_PX and _PY."""
    names = [(f"CA_ROTOR{k}_PX", f"CA_ROTOR{k}_PY") for k in range(n_rotors)]
    if not all(name in parameters for pair in names for name in pair):
        return ""
    x, y = (np.array([parameters[pair[k]] for pair in names]) for k in range(2))
    reach = float(np.hypot(x, y).max())
    if not np.isfinite(reach) or reach <= 0.0:
        return ""
    places = np.unique(np.round(np.column_stack([x, y]) / reach, 2), axis=0)
    coaxial = ", coaxial pairs" if 2 * len(places) == n_rotors else ""
    ahead = np.abs(places[:, 1]) < 0.05
    return f"{coaxial}, one straight ahead" if (ahead & (places[:, 0] > 0.5)).any() else coaxial


def mode_names(version: Version | None) -> Mapping[int, str]:
    """Return the flight modes by nav_state."""
    is_old = version is not None and version[:2] < _RENUMBERED_AT
    return _NAV_STATES | _OLD_NAV_STATES if is_old else _NAV_STATES
