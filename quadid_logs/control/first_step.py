"""The first step of an axis that oscillates and has no model: by rule, and never to more gain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.data.health import AxisOscillation, OscillatingLoop
from quadid_logs.data.tuning import AxisTuning, GainChange, GainNames
from quadid_logs.diagnose.findings import finding, rounded

#: A loop that oscillates steadily is at its limit of stability; half of its gain is 6 dB away from it, the
#: gain margin of good loops. One whose oscillation is held by a limit may be further beyond: it oscillates
#: again, more slowly or less, and takes the same step again.
_HALF: Final = 0.5


def first_step(
    refused: AxisTuning, oscillation: AxisOscillation, names: GainNames, parameters: Mapping[str, float]
) -> AxisTuning:
    """Return a step by rule instead of a bare refusal.

    Parameters
    ----------
    refused : AxisTuning
        Without advice from a model.
    oscillation : AxisOscillation
        Of this axis, commanded by nobody.
    names : GainNames
    parameters : mapping of str to float
        That flew.

    Returns
    -------
    AxisTuning
        The refusal itself where the firmware has no gain that would help.
    """
    outer = oscillation.loop is OscillatingLoop.OUTER
    wanted = (names.angle,) if outer else names.scaled
    gains = {}
    for name in wanted:
        now = parameters.get(name, float("nan"))
        after = names.written(_HALF * now) if np.isfinite(now) else now
        if name and 0.0 < after < now:
            gains[name] = GainChange(now, after, after)
    if not gains:
        return refused
    what = "the angle gain" if outer else "P, I and D"
    rule = finding(
        "QL648",
        "warning",
        {"oscillation_hz": rounded(oscillation.line.frequency_hz), "loop": oscillation.loop.value},
        axes=(oscillation.axis,),
        title=(
            f"Halve {what}, by rule and not by a model: {oscillation.axis} oscillates at "
            f"{oscillation.line.frequency_hz:.1f} Hz"
        ),
    )
    return AxisTuning(verdict="change", reasons=(rule, *refused.reasons), gains=gains, now=refused.now)
