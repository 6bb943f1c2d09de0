"""Ranges of ArduCopter's gains, by version.

The firmware's own metadata (@Range, published as ``Copter-4.0`` to ``Copter-4.8/apm.pdef.xml`` of
ArduPilot/ParameterRepository), of multirotors: the same names stand there again for helicopters, with less.
"""

from __future__ import annotations

from typing import Final

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
