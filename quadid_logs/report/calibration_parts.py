"""An effectiveness per newton metre is uncertain twice: by the flight, and by the calibration."""

from __future__ import annotations

import math

from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import Parameter
from quadid_logs.maths.normal import NORMAL_95

_INPUTS = ("L", "M", "N")


def calibration_half_width(parameter: Parameter, given: InputDescription | None) -> float:
    """Return the part of an interval that is the calibration's.

    Parameters
    ----------
    parameter : Parameter
        An element of B.

    Returns
    -------
    float
        Half width of 95 %, in the parameter's unit; 0 for A, and for a normalised command.
    """
    if given is None or given.unit == "1" or parameter.regressor not in _INPUTS:
        return 0.0
    # Every row of B is divided by the same newton metres of its input.
    sigma = given.calibration.relative_sigma[_INPUTS.index(parameter.regressor)]
    return NORMAL_95 * abs(parameter.value) * (sigma if math.isfinite(sigma) else 0.0)


def flight_interval(parameter: Parameter, given: InputDescription | None) -> tuple[float, float]:
    """Return the interval without the calibration's part: what this flight knows of the effect of a command.

    The 95 % interval [low, high] that holds between flights with the same calibration. Both parts are
    independent: their squares add up to the whole.
    """
    spread = calibration_half_width(parameter, given)
    low, high = (
        math.copysign(math.sqrt(max(0.0, (end - parameter.value) ** 2 - spread**2)), end - parameter.value)
        if math.isfinite(end)
        else end - parameter.value
        for end in parameter.ci95
    )
    return parameter.value + low, parameter.value + high
