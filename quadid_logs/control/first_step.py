"""The first step where there is no model, by rule: less gain of an axis that oscillates, or less noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.data.health import AxisOscillation, OscillatingLoop
from quadid_logs.data.tuning import AxisTuning, FilterChoices, GainChange, GainNames, written_hz
from quadid_logs.diagnose.findings import finding, rounded

#: A loop that oscillates steadily is at its limit of stability; half of its gain is 6 dB away from it, the
#: gain margin of good loops. One whose oscillation is held by a limit may be further beyond: it oscillates
#: again, more slowly or less, and takes the same step again.
_HALF: Final = 0.5


def quieter_step(
    refused: Mapping[str, AxisTuning],
    choices: FilterChoices,
    parameters: Mapping[str, float],
    noise: Callable[[str, Mapping[str, float]], float],
) -> dict[str, AxisTuning]:
    """Return a step by rule to less noise, where noise leaves no axis a model.

    Parameters
    ----------
    refused : mapping of str to AxisTuning
        Every axis, without advice from a model.
    choices : FilterChoices
    parameters : mapping of str to float
        That flew.
    noise : callable
        Standard deviation of the command that noise makes, of the command's range, by axis and the
        parameters of filters that change.

    Returns
    -------
    dict of str to AxisTuning
        The refusals themselves where nothing makes less noise.

    Notes
    -----
    A cut-off is halved, or set to the firmware's default where that is more. Beside that one setting of the
    notches is chosen: one on a line far above a loop takes a degree or two of its phase.
    """

    def halved(axis: str) -> dict[str, float]:
        names = (name for each in (*choices.shared, *choices.own.get(axis, ())) for name in each)
        lowest = {name: max(_HALF * parameters[name], choices.defaults.get(name, np.inf)) for name in names}
        return {name: written_hz(one) for name, one in lowest.items() if one < parameters[name]}

    low_passes = {axis: halved(axis) for axis in refused}
    notches = min(
        ({}, *choices.notches),
        key=lambda one: max(noise(axis, {**filters, **one}) for axis, filters in low_passes.items()),
    )
    most = max(noise(axis, {}) for axis in refused)
    changed = {}
    for axis, one in refused.items():
        filters = {**low_passes[axis], **notches}
        changes = {
            name: GainChange(parameters.get(name, np.nan), after, after)
            for name, after in filters.items()
            if parameters.get(name) != after
        }
        if not changes:
            changed[axis] = one
            continue
        percent = rounded(100.0 * most, 2)
        rule = finding(
            "QL649",
            "warning",
            {"noise_percent": percent, "filters": filters},
            axes=(axis,),
            title=f"Filter more, by rule and not by a model: noise is {percent:g} % of the command's range",
        )
        changed[axis] = replace(one, verdict="change", reasons=(rule, *one.reasons), filters=changes)
    return changed


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
