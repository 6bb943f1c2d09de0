"""What an effectiveness means for a vehicle in the air, and beside vehicles that others have published."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from quadid_logs.data.model import Parameter
from quadid_logs.data.result import Result
from quadid_logs.report.numbers import number
from quadid_logs.report.verdict import input_unit, refused_names
from quadid_logs.vocabulary import AXES, ON_AXIS

#: A correction that every pilot knows: a tenth of what the axis can do, and a tilt that is plainly seen.
_COMMAND: Final = 0.1
_TURN_DEG: Final = 10.0


def meaning_sentence(result: Result, axis: str) -> str:
    """Say what the effectiveness of an axis means, "" where there is none to be trusted.

    With the effectiveness B, a command u turns the vehicle by the angle a within
    sqrt(2 a / (B u)), after lag and delay of the actuator; damping does little over so short a time.
    With torque in N m, 1 / B is the moment of inertia.

    Parameters
    ----------
    axis : str
        roll, pitch or yaw.
    """
    model, gain = result.identification.recommended, _trusted(result, axis)
    if model is None or gain is None:
        return ""
    if input_unit(result) == "N m":
        # The moment of inertia [kg m^2], of the tensor where there is one.
        if model.inertia is not None:
            place = AXES.index(axis)
            inertia = float(model.inertia.matrix[place, place])
        else:
            inertia = 1.0 / gain.value
        return f"As a moment of inertia: {number(1e3 * inertia, 3)} g m²."
    # How long the actuator takes [s].
    known = () if model.actuator is None else (model.actuator.lag_s, model.actuator.delay_s)
    wait_s = math.sqrt(2.0 * math.radians(_TURN_DEG) / (_COMMAND * gain.value)) + float(
        np.sum([value for value in known if math.isfinite(value)])
    )
    return f"A {axis} command of 10 % turns the vehicle by {_TURN_DEG:g} degrees in {number(wait_s, 2)} s."


def _trusted(result: Result, axis: str) -> Parameter | None:
    """Return the on-axis effectiveness, None where it is refused or of the wrong sign."""
    model = result.identification.recommended
    gain = None if model is None else model.entries.get(ON_AXIS[axis])
    if gain is None or axis in refused_names(result) or not gain.value > 0.0 or not math.isfinite(gain.value):
        return None
    return gain


def beside_published(result: Result) -> str:
    """Say how the effectiveness compares with that of published vehicles, "" where it cannot be said.

    For the published ones, a normalised command of one is taken for half of the thrust on each side, as the
    mixers of autopilots do, and the largest thrust for twice the weight: B = m g l / I, with the lever l.
    """
    # Not at the top: it brings the whole simulator with it.
    from quadid_logs.simulator.published import PUBLISHED

    found = [_trusted(result, axis) for axis in AXES[:2]]
    gains = [gain.value for gain in found if gain is not None]
    if not gains:
        return ""
    if input_unit(result) == "N m":
        own = 1.0 / float(np.mean(gains))
        nearest = min(PUBLISHED, key=lambda one: abs(math.log(one.inertia_kg_m2[0] / own)))
        return (
            f"The published vehicle with the nearest moments of inertia: {nearest.name} "
            f"({number(nearest.mass_kg, 3)} kg, Ixx {number(1e3 * nearest.inertia_kg_m2[0], 3)} g m²)."
        )
    by_gain = sorted(PUBLISHED, key=lambda one: one.roll_effectiveness)
    low, high = by_gain[0], by_gain[-1]
    return (
        f"For comparison, published quadrotors at full roll command: {number(low.roll_effectiveness, 2)} "
        f"({low.name}, {number(low.mass_kg, 2)} kg) to {number(high.roll_effectiveness, 2)} rad/s² "
        f"({high.name}, {number(high.mass_kg, 2)} kg), if they can lift twice their weight."
    )
