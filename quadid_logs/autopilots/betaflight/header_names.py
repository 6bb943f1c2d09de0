"""Settings of older headers under the names and in the units of later ones.

Source: ``blackbox.c`` (``blackboxWriteSysinfo``) of 3.0.0, 3.0.1, 3.1.3, 3.1.7, 3.2.0, 3.3.3, 3.4.0, 3.5.7
and 4.0.0, and of Cleanflight in April 2016.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Final

#: Names before 3.2, or before 3.3, and what took their place; a value for roll and pitch goes to both.
_RENAMED: Final[dict[str, tuple[str, ...]]] = {
    "rcRate": ("rc_rates[0]", "rc_rates[1]"),
    "rc_rate": ("rc_rates[0]", "rc_rates[1]"),
    "rcYawRate": ("rc_rates[2]",),
    "rc_rate_yaw": ("rc_rates[2]",),
    "rcExpo": ("rc_expo[0]", "rc_expo[1]"),
    "rc_expo": ("rc_expo[0]", "rc_expo[1]"),
    "rcYawExpo": ("rc_expo[2]",),
    "rc_expo_yaw": ("rc_expo[2]",),
    "rc_yaw_expo": ("rc_expo[2]",),
    "dynThrPID": ("tpa_rate",),
    "fast_pwm_protocol": ("motor_pwm_protocol",),
    "gyro_soft_type": ("gyro_lowpass_type",),
    "gyro_notch_hz": ("gyro_notch_hz[0]",),
    "gyro_notch_cutoff": ("gyro_notch_cutoff[0]",),
    "dterm_lpf_hz": ("dterm_lowpass_hz",),
    "yaw_lpf_hz": ("yaw_lowpass_hz",),
    "dtermSetpointWeight": ("dterm_setpoint_weight",),
    "minthrottle": ("motorOutput[0]",),
    "maxthrottle": ("motorOutput[1]",),
}
#: 3.1 wrote the 32 bits of a floating point number as a whole one: what took its place, and its unit of that.
_BITS: Final = {
    "yawRateAccelLimit": ("acc_limit_yaw", 10.0),
    "rateAccelLimit": ("acc_limit", 10.0),
    "pidSumLimit": ("pidsum_limit", 1000.0),
    "pidSumLimitYaw": ("pidsum_limit_yaw", 1000.0),
}
#: Before 3.1 cut-offs were written in hundredths.
_HUNDREDTHS: Final = (
    "dterm_lowpass_hz", "yaw_lowpass_hz", "gyro_lowpass_hz", "dterm_notch_hz", "dterm_notch_cutoff",
    "gyro_notch_hz[0]", "gyro_notch_cutoff[0]",
)  # fmt: skip
#: Yaw's sum has had a limit of its own since 3.2; before, it was that of all axes, 500.
_OWN_YAW_LIMIT_SINCE: Final = (3, 2)
_WHOLE_NUMBERS_SINCE: Final = (3, 1)
#: D of yaw was set, and logged as 0.
_YAW_DERIVATIVE_SINCE: Final = (3, 5)
#: Throttle attenuated P and D alike until `tpa_mode` let D stand alone.
_TPA_MODE_SINCE: Final = (4, 0)
_GYRO_SCALES: Final = ("gyro_scale", "gyro.scale")


def with_later_names(settings: Mapping[str, float], version: tuple[int, ...] | None) -> dict[str, float]:
    """Return the settings with those that had other names or units before.

    Parameters
    ----------
    version : tuple of int or None
        Of the firmware; None for one that is recent or not known.

    Returns
    -------
    dict of str to float
        What stands under its later name already stays.
    """
    found = dict(settings)
    for name, later in _RENAMED.items():
        if name in settings:
            found |= {one: settings[name] for one in later if one not in settings}
    for name, (one, unit) in _BITS.items():
        value = float_of_bits(settings.get(name))
        if math.isfinite(value) and one not in settings:
            found[one] = unit * value
    if version is None:
        return found
    if version < _WHOLE_NUMBERS_SINCE:
        found |= {name: 0.01 * found[name] for name in _HUNDREDTHS if name in found}
    if version < _OWN_YAW_LIMIT_SINCE:
        found.setdefault("pidsum_limit_yaw", found.get("pidsum_limit", 500.0))
    if version < _YAW_DERIVATIVE_SINCE and "yawPID[2]" in found:
        found["yawPID[2]"] = 0.0
    if version < _TPA_MODE_SINCE:
        found.setdefault("tpa_mode", 0.0)
    return found


def gyro_scale(texts: Mapping[str, str]) -> float:
    """Return how many degrees per second a unit of the logged gyro is.

    Parameters
    ----------
    texts : mapping of str to str
        Of the header, which holds the 32 bits of the number.

    Returns
    -------
    float
        1 where the header does not say; NaN where it holds what is no scale.
    """
    text = next((texts[name] for name in _GYRO_SCALES if name in texts), "0x3f800000")
    try:
        found = float_of_bits(float(int(text, 16)))
    except (ValueError, OverflowError):
        return math.nan
    # No sensor of these boards has a range beyond 4000 degrees per second in 16 bits, nor one below 125.
    return found if 125.0 / 32768.0 < found < 4000.0 / 32768.0 or found == 1.0 else math.nan


def float_of_bits(number: float | None) -> float:
    """Return the number of single precision whose bits a whole number holds, NaN for none."""
    if number is None or not 0.0 <= number < 2.0**32:
        return math.nan
    return float(struct.unpack("<f", struct.pack("<I", int(number)))[0])
