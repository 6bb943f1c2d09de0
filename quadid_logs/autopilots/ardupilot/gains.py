"""ArduPilot's gains of multirotors: names, documented ranges, and what is no multirotor.

Ranges: the firmware's own metadata (@Range, published as ``Copter-4.0`` to ``Copter-4.8/apm.pdef.xml`` of
ArduPilot/ParameterRepository), of multirotors: the same names stand there again for helicopters, with less.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES
from quadid_logs.data.autotune import Doubling, Procedure, Twitching
from quadid_logs.data.log import whole_number
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
#: The highest cut-off of the error's filter that QuikTune leaves in yaw [Hz].
_QUIKTUNE_YAW_FLTE_HZ: Final = 2.0
#: AC_AttitudeControl_Multi: by what follows ATC_RAT_, the same from 4.0 to 4.8.
_RATE: Final = {
    "RLL": {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05)},
    "PIT": {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05)},
    "YAW": {"P": (0.1, 2.5), "I": (0.01, 1.0), "D": (0.0, 0.02)},
}
#: AC_AttitudeControl, ATC_ANG_*_P: since 4.1, and in 4.0.
_ANGLE: Final = (3.0, 12.0)
_ANGLE_BEFORE: Final = {"RLL": (0.0, 12.0), "PIT": (0.0, 12.0), "YAW": (0.0, 6.0)}
_SINCE: Final = (4, 1)


def tunable(parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
    """Return the gains that may be changed."""
    if parameters.get("Q_ENABLE", 0.0) > 0.0:
        obstacle = "a plane that hovers (Q_ENABLE)"
    elif parameters.get("CC_TYPE", 0.0) > 0.0:
        obstacle = "flown by a custom controller (CC_TYPE)"
    else:
        obstacle = _NOT_TUNED.get(whole_number(parameters.get("FRAME_CLASS")), "")
    axes = {}
    procedures: dict[str, tuple[Procedure, ...]] = {}
    for axis, name in AXIS_NAMES.items():
        prefix = f"ATC_RAT_{name}_"
        axes[axis] = GainNames(
            scaled=tuple(f"{prefix}{short}" for short in "PID"),
            proportional=f"{prefix}P",
            integral=f"{prefix}I",
            derivative=f"{prefix}D",
            filters=(f"{prefix}FLTD", "INS_GYRO_FILTER"),
            low_passes=(f"{prefix}FLTE", f"{prefix}FLTD", "INS_GYRO_FILTER"),
            angle=f"ATC_ANG_{name}_P",
            ranges=gain_ranges(name, version),
        )
        procedures[axis] = (*_autotune(parameters, axis), _quiktune(parameters, name))
    return Tunable(axes=axes, obstacle=obstacle, procedures=procedures)


def _autotune(parameters: Mapping[str, float], axis: str) -> Iterator[Twitching]:
    """Yield AutoTune of roll or pitch, as in AC_AutoTune_Multi.cpp; in yaw it varies a filter."""
    if axis == "yaw":
        return
    cutoff_hz = parameters.get(f"ATC_RAT_{AXIS_NAMES[axis]}_FLTD", 0.0)
    yield Twitching(
        title="AutoTune",
        aggressiveness=min(max(parameters.get("AUTOTUNE_AGGR", 0.075), 0.05), 0.2),
        filter_hz=2.0 * cutoff_hz if 0.0 < cutoff_hz < math.inf else 0.0,
        derivative=(min(max(parameters.get("AUTOTUNE_MIN_D", 0.0005), 1e-5), 0.2), 0.2),
        proportional=(0.01, 2.0),
        angle=(0.5, 40.0),
        integral_ratio=1.0,
        angle_back_off=0.9,
    )


def _quiktune(parameters: Mapping[str, float], name: str) -> Doubling:
    """Return QuikTune of one axis, as in AP_Quicktune.cpp and VTOL-quicktune.lua."""

    def option(short: str, default: float, older: str = "") -> float:
        for prefix, each in (("QWIK_", short), ("QUIK_", older or short)):
            if f"{prefix}{each}" in parameters:
                return parameters[f"{prefix}{each}"]
        return default

    prefix, is_yaw = f"ATC_RAT_{name}_", name == "YAW"
    filters = {}
    if option("AUTO_FILTER", 1.0) > 0.0:
        half_hz = 0.5 * parameters.get("INS_GYRO_FILTER", 20.0)
        filters = {f"{prefix}FLTT": half_hz, f"{prefix}FLTD": half_hz}
        error_hz = parameters.get(f"{prefix}FLTE", 0.0)
        if is_yaw and not 0.0 < error_hz <= _QUIKTUNE_YAW_FLTE_HZ:
            filters[f"{prefix}FLTE"] = _QUIKTUNE_YAW_FLTE_HZ
    ratio = option("Y_PI_RATIO", 10.0) if is_yaw else option("RP_PI_RATIO", 1.0)
    least = option("REDUCE_MAX", 20.0, "MAX_REDUCE")
    return Doubling(
        title="QuikTune",
        filters=filters,
        kept=1.0 - 0.01 * option("GAIN_MARGIN", 60.0),
        least_of_flown=1.0 - 0.01 * least if 0.0 <= least < 100.0 else 0.0,
        integral_ratio=1.0 / ratio if ratio >= 1.0 and parameters.get(f"{prefix}FF", 0.0) <= 0.0 else None,
        highest_proportional=(option("YAW_P_MAX", 0.5) or math.inf) if is_yaw else math.inf,
        highest_derivative=(option("YAW_D_MAX", 0.01) or math.inf) if is_yaw else math.inf,
        lowers_p=not is_yaw,
    )


def gain_ranges(name: str, version: tuple[int, ...] | None) -> dict[str, tuple[float, float]]:
    """Return the documented ranges of one axis' gains.

    Parameters
    ----------
    name : str
        RLL, PIT or YAW.
    version : tuple of int or None
        Of the firmware, most significant first; the ranges of later ones where it is not told.

    Returns
    -------
    dict of str to (float, float)
        Lowest and highest value by parameter.
    """
    angle = _ANGLE if version is None or version >= _SINCE else _ANGLE_BEFORE[name]
    rate = {f"ATC_RAT_{name}_{short}": ends for short, ends in _RATE[name].items()}
    return rate | {f"ATC_ANG_{name}_P": angle}
