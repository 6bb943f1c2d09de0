"""ArduPilot's gains of multirotors: names, and what is no multirotor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES
from quadid_logs.autopilots.ardupilot.ranges import gain_ranges
from quadid_logs.data.autotune import Twitching
from quadid_logs.data.tuning import GainNames, Tunable

#: AP_Motors_Class.h, FRAME_CLASS: what is no multirotor with the controllers that are known here.
_NOT_TUNED: Final = {
    6: "a helicopter",
    8: "a single copter",
    9: "a coaxial copter",
    10: "a tail-sitter",
    11: "a helicopter",
    13: "a helicopter",
}


def tunable(parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
    """Return the gains that may be changed.

    Parameters
    ----------
    parameters : mapping of str to float
        Of the log.
    version : tuple of int, optional
        Of its firmware.

    Returns
    -------
    Tunable
    """
    axes = {axis: _names(name, version) for axis, name in AXIS_NAMES.items()}
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


def _names(name: str, version: tuple[int, ...] | None) -> GainNames:
    prefix = f"ATC_RAT_{name}_"
    return GainNames(
        scaled=tuple(f"{prefix}{short}" for short in "PID"),
        proportional=f"{prefix}P",
        integral=f"{prefix}I",
        derivative=f"{prefix}D",
        filters=(f"{prefix}FLTD", "INS_GYRO_FILTER"),
        low_passes=(f"{prefix}FLTE", f"{prefix}FLTD", "INS_GYRO_FILTER"),
        angle=f"ATC_ANG_{name}_P",
        ranges=gain_ranges(name, version),
    )


def _obstacle(parameters: Mapping[str, float]) -> str:
    """Name what is no plain multirotor with AC_PID."""
    if parameters.get("Q_ENABLE", 0.0) > 0.0:
        return "a plane that hovers (Q_ENABLE)"
    if parameters.get("CC_TYPE", 0.0) > 0.0:
        return "flown by a custom controller (CC_TYPE)"
    frame = parameters.get("FRAME_CLASS", 0.0)
    return next((words for number, words in _NOT_TUNED.items() if frame == number), "")
