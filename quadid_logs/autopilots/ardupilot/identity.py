"""What flew: firmware, vehicle type, frame and flight modes in ArduPilot's words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from quadid_logs.autopilots.modes import ardupilot_modes
from quadid_logs.data.log import whole_number

#: ArduPilot libraries/AP_Vehicle/AP_Vehicle_Type.h, logged as VER.BU.
_BUILD_TYPES: Final = {
    1: "rover", 2: "multirotor", 3: "fixed-wing", 4: "tracker", 7: "submarine", 13: "helicopter",
}  # fmt: skip
#: Parameters.h of each vehicle, `k_software_type`, logged by old firmware as SYSID_SW_TYPE.
_SOFTWARE_TYPES: Final = {0: "fixed-wing", 4: "tracker", 10: "multirotor", 20: "rover", 40: "submarine"}
_FIRMWARE_NAMES: Final = {
    "copter": "multirotor", "plane": "fixed-wing", "rover": "rover", "rover2": "rover", "sub": "submarine",
    "antennatracker": "tracker", "tracker": "tracker", "blimp": "unknown",
}  # fmt: skip
_FIRMWARE: Final = re.compile(
    r"^(?:APM:|Ardu|APM)?(copter|plane|rover2?|sub|antennatracker|tracker|blimp)\s+V?(\d+)\.(\d+)",
    re.IGNORECASE,
)
_HARDWARE: Final = re.compile(r"^\S+ [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$")
_FRAME_TEXT: Final = re.compile(r"^Frame: (\S.*)$")

#: AP_Motors_Class.h, `motor_frame_class`.
FRAME_CLASSES: Final = {
    1: "quad", 2: "hexa", 3: "octa", 4: "octa-quad", 5: "Y6", 6: "helicopter", 7: "tri", 8: "single",
    9: "coax", 10: "bicopter", 11: "dual helicopter", 12: "dodeca-hexa", 13: "quad helicopter", 14: "deca",
    15: "scripted matrix", 16: "six-axis scripted matrix", 17: "dynamic scripted matrix",
}  # fmt: skip
#: AP_Motors_Class.h, `motor_frame_type`; the first five also of the old parameter FRAME.
FRAME_TYPES: Final = {
    0: "plus", 1: "X", 2: "V", 3: "H", 4: "V-tail", 5: "A-tail", 6: "plus reversed", 10: "Y6B", 11: "Y6F",
    12: "Betaflight X", 13: "DJI X", 14: "clockwise X", 15: "I", 16: "NYT plus", 17: "NYT X",
    18: "Betaflight X reversed", 19: "Y4",
}  # fmt: skip
#: Firmware before 3.1 was built for one number of motors.
_BUILDS: Final = {3: "tri", 4: "quad", 6: "six-motor", 8: "eight-motor"}
_HELICOPTERS: Final = frozenset({6, 11, 13})
#: Steered by vanes or by tilting, not by the thrust of three or more fixed rotors.
_VANES: Final = frozenset({8, 9, 10})

#: ArduCopter/mode.h, `Mode::Number`; 8 and 10 belong to firmware before 3.2.
COPTER_MODES: Final = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE",
    8: "POSITION", 9: "LAND", 10: "OF_LOITER", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE",
    16: "POSHOLD", 17: "BRAKE", 18: "THROW", 19: "AVOID_ADSB", 20: "GUIDED_NOGPS", 21: "SMART_RTL",
    22: "FLOWHOLD", 23: "FOLLOW", 24: "ZIGZAG", 25: "SYSTEMID", 26: "AUTOROTATE", 27: "AUTO_RTL",
    28: "TURTLE",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleIdentity:
    """What the log says about the vehicle; untrusted text."""

    firmware: str
    version: tuple[int, int] | None
    vehicle_type: str
    frame: str
    hardware_id: str


def identify_vehicle(
    texts: Sequence[str], parameters: Mapping[str, float], *, build_type: int | None, n_motors: int
) -> VehicleIdentity:
    """Tell firmware, vehicle type and frame from messages, parameters and VER.BU.

    Parameters
    ----------
    texts : sequence of str
        VER.FWS, then lines before the first FMT, then MSG texts.
    build_type : int or None
        VER.BU, None where not logged.
    n_motors : int
        Fields of the old message MOT, which were one per motor of the build; 0 where undefined.
    """
    firmware = next((text for text in texts if _FIRMWARE.match(text)), "")
    match = _FIRMWARE.match(firmware)
    flown_by = (
        _BUILD_TYPES.get(-1 if build_type is None else build_type)
        or (_FIRMWARE_NAMES.get(match[1].lower()) if match else None)
        or _SOFTWARE_TYPES.get(whole_number(parameters.get("SYSID_SW_TYPE"), -1), "unknown")
    )
    frame_text = next((found[1] for text in reversed(texts) if (found := _FRAME_TEXT.match(text))), "")
    vehicle_type = _refine_type(flown_by, parameters, frame_text)
    return VehicleIdentity(
        firmware=firmware,
        version=(int(match[2]), int(match[3])) if match else None,
        vehicle_type=vehicle_type,
        frame=_frame(vehicle_type, parameters, frame_text, n_motors),
        hardware_id=next((text for text in texts if _HARDWARE.match(text)), ""),
    )


def mode_name(mode: str | float, vehicle_type: str) -> str:
    """Return a flight mode's name: as logged, from the tables by vehicle, or its number."""
    if isinstance(mode, str) and not (mode.isascii() and mode.isdigit()):
        return mode.upper()
    number = whole_number(float(mode), -1)
    if vehicle_type in ("multirotor", "helicopter") and number in COPTER_MODES:
        return COPTER_MODES[number]
    return ardupilot_modes(vehicle_type).get(number) or f"mode {number}"


def _refine_type(flown_by: str, parameters: Mapping[str, float], frame_text: str) -> str:
    """Tell helicopters, QuadPlanes and boats from what has the same firmware."""
    frame_class = whole_number(parameters.get("FRAME_CLASS"), -1)
    if flown_by == "fixed-wing":
        return "vtol" if parameters.get("Q_ENABLE", 0.0) > 0 else flown_by
    if flown_by == "rover":
        return "boat" if frame_class == 2 else flown_by
    if flown_by != "multirotor":
        return flown_by
    has_swashplate = any(
        name in parameters for name in ("H_SWASH_TYPE", "H_SW_TYPE", "H_SWASH_PLATE", "H_COL_MAX")
    )
    if frame_class in _HELICOPTERS or has_swashplate or "HELI" in frame_text.upper():
        return "helicopter"
    return "unknown" if frame_class in _VANES else flown_by


def _frame(vehicle_type: str, parameters: Mapping[str, float], frame_text: str, n_motors: int) -> str:
    """Describe the frame in words, for example "quad X"."""
    if vehicle_type not in ("multirotor", "helicopter", "vtol", "unknown"):
        return ""
    prefix = "Q_" if vehicle_type == "vtol" else ""
    frame_class = FRAME_CLASSES.get(whole_number(parameters.get(f"{prefix}FRAME_CLASS"), -1), "")
    type_number = parameters.get(f"{prefix}FRAME_TYPE", parameters.get("FRAME"))
    frame_type = FRAME_TYPES.get(whole_number(type_number, -1), "")
    if not frame_class and frame_text:
        frame_class = frame_text.split("/")[0].lower()
    if not frame_class:
        frame_class = _BUILDS.get(n_motors, "")
    if "Y6" in frame_class.upper() and frame_type in ("Y6B", "Y6F"):
        frame_class = ""
    return " ".join(filter(None, (frame_class, frame_type)))
