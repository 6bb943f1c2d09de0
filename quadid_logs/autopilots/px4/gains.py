"""PX4's gains of multirotors: names, documented ranges, and what is no multirotor.

Ranges: @min and @max in mc_rate_control_params.c and mc_att_control_params.c of 1.14, 1.15 and 1.16, and in
the YAML that followed them: only the lowest gain K of yaw differs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.px4.controller import AXIS_NAMES
from quadid_logs.data.autotune import PolePlacement
from quadid_logs.data.log import whole_number
from quadid_logs.data.tuning import GainNames, Tunable

_FILTERS: Final = ("IMU_DGYRO_CUTOFF", "IMU_GYRO_CUTOFF")
#: Of CA_AIRFRAME: a multirotor, and one with tilted rotors.
_MULTIROTORS: Final = (0.0, 6.0)
#: MAV_TYPE of planes and of what takes off vertically and flies as one (MAVLink, MAV_TYPE).
_NOT_TUNED: Final = {1: "a plane", 4: "a helicopter", **dict.fromkeys(range(19, 26), "a VTOL")}
#: By what follows MC_ROLLRATE_; no highest value is documented of I, nor of D of pitch and yaw.
_RATE: Final = {
    "ROLL": {"K": (0.01, 5.0), "P": (0.01, 0.5), "I": (0.0, math.inf), "D": (0.0, 0.01)},
    "PITCH": {"K": (0.01, 5.0), "P": (0.01, 0.6), "I": (0.0, math.inf), "D": (0.0, math.inf)},
    "YAW": {"K": (0.01, 5.0), "P": (0.0, 0.6), "I": (0.0, math.inf), "D": (0.0, math.inf)},
}
#: MC_ROLL_P and its likes.
_ANGLE: Final = {"ROLL": (0.0, 12.0), "PITCH": (0.0, 12.0), "YAW": (0.0, 5.0)}
#: Up to this version MC_YAWRATE_K may be 0.
_UP_TO: Final = (1, 16)


def tunable(parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
    """Return the gains that may be changed.

    P, I and D together are scaled by MC_ROLLRATE_K and its likes where the firmware has them.
    """
    if parameters.get("CA_AIRFRAME", 0.0) not in _MULTIROTORS:
        obstacle = "no multirotor (CA_AIRFRAME)"
    else:
        obstacle = _NOT_TUNED.get(whole_number(parameters.get("MAV_TYPE"), 2), "")
    axes = {}
    for axis, (name, _) in AXIS_NAMES.items():
        prefix = f"MC_{name}RATE_"
        # Before 1.10 there is no K.
        common = (f"{prefix}K",) if f"{prefix}K" in parameters else tuple(f"{prefix}{one}" for one in "PID")
        axes[axis] = GainNames(
            scaled=common,
            proportional=f"{prefix}P",
            integral=f"{prefix}I",
            derivative=f"{prefix}D",
            filters=_FILTERS,
            low_passes=_FILTERS if name != "YAW" else (*_FILTERS, "MC_YAW_TQ_CUTOFF"),
            angle=f"MC_{name}_P",
            ranges=gain_ranges(name, version),
        )
    return Tunable(
        axes=axes,
        obstacle=obstacle,
        procedures={axis: (_autotune(parameters, name),) for axis, (name, _) in AXIS_NAMES.items()},
    )


def _autotune(parameters: Mapping[str, float], name: str) -> PolePlacement:
    """Return the autotune of one axis: mc_autotune_attitude_control.cpp, pid_design.hpp."""
    rise_s = 0.2 if name == "YAW" else parameters.get("MC_AT_RISE_TIME", 0.14)
    cutoff_hz, common = parameters.get("IMU_GYRO_CUTOFF", 40.0), f"MC_{name}RATE_K"
    return PolePlacement(
        title="The autotune in flight",
        rise_time_s=min(max(rise_s, 0.01), 1.0),
        model_period_s=min(max(0.5 / cutoff_hz if cutoff_hz > 0.0 else 0.01, 0.002), 0.01),
        excitation_per_s=5.0,
        detuning=0.7,
        angle_error_rad=math.radians(60.0),
        angle_gains=(2.0, 6.5),
        highest=(0.5, 10.0, 0.1),
        common=common if common in parameters else "",
    )


def gain_ranges(name: str, version: tuple[int, ...] | None) -> dict[str, tuple[float, float]]:
    """Return the documented ranges of one axis' gains.

    Parameters
    ----------
    name : str
        ROLL, PITCH or YAW.
    version : tuple of int or None
        Of the firmware, most significant first; the ranges of later ones where it is not told.

    Returns
    -------
    dict of str to (float, float)
        Lowest and highest value by parameter; infinite where none is documented.
    """
    ranges = {f"MC_{name}RATE_{short}": ends for short, ends in _RATE[name].items()}
    if name == "YAW" and version is not None and version[:2] <= _UP_TO:
        ranges["MC_YAWRATE_K"] = (0.0, 5.0)
    return ranges | {f"MC_{name}_P": _ANGLE[name]}
