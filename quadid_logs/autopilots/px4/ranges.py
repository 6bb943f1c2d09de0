"""Ranges of PX4's gains: @min and @max of the parameters' metadata, by version.

mc_rate_control_params.c and mc_att_control_params.c of 1.14, 1.15 and 1.16, and the YAML that followed them:
only the lowest gain K of yaw differs.
"""

from __future__ import annotations

import math
from typing import Final

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
