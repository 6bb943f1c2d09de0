"""What to do next: after a flight that says too little, and after one that says enough."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import PurePath
from typing import Final

from quadid_logs.control.findings import outermost
from quadid_logs.data.closed_loop import Margins
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD
from quadid_logs.diagnose.advice import next_steps as ordered_steps
from quadid_logs.report.numbers import number
from quadid_logs.report.verdict import refused_names
from quadid_logs.untrusted import printable

_MOST_STEPS: Final = 5


def next_steps(result: Result) -> tuple[str, ...]:
    """Return what to do next.

    Where an axis is refused: the advice of the gravest findings, each once, what is to be set first.
    Where none is: such advice if there is any, then what the model is good for.

    Parameters
    ----------
    result : Result

    Returns
    -------
    tuple of str
        At most `_MOST_STEPS`.
    """
    advice = ordered_steps((result.log, finding) for finding in result.diagnosis.findings)
    steps = [printable(step, 800) for step in advice[:_MOST_STEPS]]
    if not refused_names(result) and result.identification.recommended is not None:
        further = list(_with_the_model(result))
        steps = [*steps[: _MOST_STEPS - len(further)], *further]
    return tuple(steps)


def _with_the_model(result: Result) -> Iterator[str]:
    """Yield what a usable model is good for."""
    margins = _margins_sentence(result)
    if margins and not _gains_named(result):
        yield margins
    log = _log(result)
    yield (
        f"Use the model: `quadid-log export {log} --model -o model.mat` for MATLAB, `model.py` for "
        "python-control, `model.sdf` for Gazebo."
    )
    yield (
        "After a change of propellers, load, battery or gains, fly the same manoeuvre again and see what "
        f"it did: `quadid-log compare {_compared(result)}`"
    )


def _gains_named(result: Result) -> bool:
    """Say whether the advice of a finding already sends the pilot to the gains."""
    return any(one.code == "QL601" and one.level == "warning" for one in result.diagnosis.findings)


def _log(result: Result) -> str:
    """Return the log as one would name it on the command line."""
    name = printable(PurePath(result.log.path).name, 120)
    return f"{name} --log {result.settings.log}" if result.settings.log else name


def _compared(result: Result) -> str:
    """Return this flight and the next one as `compare` takes them."""
    name, number = printable(PurePath(result.log.path).name, 120), result.settings.log
    return f"{name} NEXT-LOG --logs {number} 0" if number else f"{name} NEXT-LOG"


def _margins_sentence(result: Result) -> str:
    """Say how far the loop that is nearest to oscillating is from it, "" where no loop is known."""
    axes = {} if result.closed_loop is None else result.closed_loop.axes
    found = {axis: margins for axis, loop in axes.items() if (margins := outermost(loop)) is not None}
    stable = {axis: margins for axis, margins in found.items() if margins.stable}
    if not stable or len(stable) < len(found):
        return ""
    nearest = min(stable, key=lambda axis: _room(stable[axis]))
    phase, gain = stable[nearest].phase_margin_deg, stable[nearest].gain_margin_db
    if phase is None or gain is None:
        return ""
    enough = "There is room to spare" if _room(stable[nearest]) >= 1.0 else "There is little room"
    return (
        f"{enough} in the gains: the axis nearest to oscillating is {nearest}, with a phase margin of "
        f"{number(phase.value, 2)} degrees and a gain margin of {number(gain.value, 2)} dB "
        f"({GOOD.phase_deg:g} degrees and {GOOD.gain_db:g} dB are enough). The next gains to fly: "
        f"`quadid-log tune {_log(result)}`"
    )


def _room(margins: Margins) -> float:
    """Return the margins over those that are enough, the smaller of gain and phase."""
    pairs = ((margins.phase_margin_deg, GOOD.phase_deg), (margins.gain_margin_db, GOOD.gain_db))
    return min((each.value / enough for each, enough in pairs if each is not None), default=math.inf)
