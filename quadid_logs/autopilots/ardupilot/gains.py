"""ArduPilot's gains of multirotors: names, documented ranges, and files of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES
from quadid_logs.data.autotune import Twitching
from quadid_logs.data.tuning import GainNames, Tunable

#: AC_AttitudeControl_Multi.h and AC_AttitudeControl.cpp, @Range of RAT_RLL_P, RAT_YAW_P, ANG_RLL_P ...
_HIGHEST: Final = {"P": 0.5, "I": 2.0, "D": 0.05}
_HIGHEST_OF_YAW: Final = {"P": 2.5, "I": 1.0, "D": 0.02}
_HIGHEST_ANGLE: Final = 12.0
#: AP_Motors_Class.h, FRAME_CLASS: what is no multirotor with the controllers that are known here.
_NOT_TUNED: Final = {
    6: "a helicopter",
    8: "a single copter",
    9: "a coaxial copter",
    10: "a tail-sitter",
    11: "a helicopter",
    13: "a helicopter",
}


def tunable(parameters: Mapping[str, float]) -> Tunable:
    """Return the gains that may be changed.

    Parameters
    ----------
    parameters : mapping of str to float
        Of the log.

    Returns
    -------
    Tunable
    """
    axes = {axis: _names(name) for axis, name in AXIS_NAMES.items()}
    return Tunable(
        axes=axes,
        obstacle=_obstacle(parameters),
        procedures={axis: _autotune(parameters, AXIS_NAMES[axis]) for axis in ("roll", "pitch")},
    )


def _autotune(parameters: Mapping[str, float], name: str) -> Twitching:
    """Return AutoTune of roll or pitch, as in AC_AutoTune_Multi.cpp; in yaw it varies a filter."""
    cutoff_hz = parameters.get(f"ATC_RAT_{name}_FLTD", 0.0)
    return Twitching(
        title="AutoTune",
        aggressiveness=min(max(parameters.get("AUTOTUNE_AGGR", 0.075), 0.05), 0.2),
        filter_hz=2.0 * cutoff_hz if 0.0 < cutoff_hz < math.inf else 0.0,
        derivative=(min(max(parameters.get("AUTOTUNE_MIN_D", 0.0005), 1e-5), 0.2), 0.2),
        proportional=(0.01, 2.0),
        angle=(0.5, 40.0),
        integral_ratio=1.0,
        angle_back_off=0.9,
    )


def _names(name: str) -> GainNames:
    prefix, angle = f"ATC_RAT_{name}_", f"ATC_ANG_{name}_P"
    highest = _HIGHEST_OF_YAW if name == "YAW" else _HIGHEST
    return GainNames(
        scaled=tuple(f"{prefix}{short}" for short in highest),
        proportional=f"{prefix}P",
        integral=f"{prefix}I",
        derivative=f"{prefix}D",
        filters=(f"{prefix}FLTD", "INS_GYRO_FILTER"),
        low_passes=(f"{prefix}FLTE", f"{prefix}FLTD", "INS_GYRO_FILTER"),
        angle=angle,
        highest={f"{prefix}{short}": value for short, value in highest.items()} | {angle: _HIGHEST_ANGLE},
    )


def _obstacle(parameters: Mapping[str, float]) -> str:
    """Name what is no plain multirotor with AC_PID."""
    if parameters.get("Q_ENABLE", 0.0) > 0.0:
        return "a plane that hovers (Q_ENABLE)"
    if parameters.get("CC_TYPE", 0.0) > 0.0:
        return "flown by a custom controller (CC_TYPE)"
    frame = parameters.get("FRAME_CLASS", 0.0)
    return next((words for number, words in _NOT_TUNED.items() if frame == number), "")
