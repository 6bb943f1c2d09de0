"""What to do next: after a flight that says too little, and after one that says enough."""

from __future__ import annotations

from typing import Final

from quadid_logs.data.catalogue import CATALOGUE, THIS_MOTOR
from quadid_logs.data.health import Health
from quadid_logs.data.result import Result
from quadid_logs.diagnose.advice import next_steps as ordered_steps
from quadid_logs.report.commands import filled, on_log, with_next_log
from quadid_logs.report.model_files import model_formats_of
from quadid_logs.report.tune_view import headline
from quadid_logs.report.verdict import refused_names
from quadid_logs.sentences import listed
from quadid_logs.tuning import tuning_of
from quadid_logs.untrusted import printable

_MOST_STEPS: Final = 5
_ASK_TUNE: Final = CATALOGUE["QL601"].advice


def next_steps(result: Result) -> tuple[str, ...]:
    """Return what to do next.

    What is wrong with the vehicle comes first: it is not to fly like that. Then, where an axis is refused,
    the advice of the gravest findings, each once, what is to be set first. Where none is: such advice if
    there is any, then what the model is good for.

    At most `_MOST_STEPS`.
    """
    found = ordered_steps((result.log, finding) for finding in result.diagnosis.findings)
    # Faults of the vehicle first.
    health = result.health or Health()
    mend = [
        _with_its_name(code, health)
        for topic in health.topics.values()
        if topic.level in ("high", "severe")
        for code in topic.findings
        if CATALOGUE[code].scope == "vehicle"
    ]
    advice = tuple(dict.fromkeys((*mend, *found)))
    if not refused_names(result) and _gains_sentence(result):
        # What `tune` says stands below: that it says something is not said beside it.
        advice = tuple(filter(None, (step.replace(_ASK_TUNE, "").strip() for step in advice)))
    steps = [filled(printable(step, 800), result) for step in advice[:_MOST_STEPS]]
    if not refused_names(result) and result.identification.recommended is not None:
        # What a usable model is good for.
        further = []
        gains = _gains_sentence(result)
        if gains:
            further.append(gains)
        if not result.pooled:
            gazebo = ", `model.sdf` for Gazebo" if ".sdf" in model_formats_of(result) else ""
            export = on_log(result, "export", "--model", "-o", "model.mat")
            further.append(f"Use the model: `{export}` for MATLAB, `model.py` for python-control{gazebo}.")
        further.append(
            "After a change of propellers, load, battery or gains, fly the same manoeuvre again. To see "
            f"what the change did, run `{with_next_log(result)}`."
        )
        steps = [*steps[: _MOST_STEPS - len(further)], *further]
    return tuple(steps)


def _with_its_name(code: str, health: Health) -> str:
    """Return the advice of a finding; in a list of steps `THIS_MOTOR` has a name."""
    rotors, advice = health.rotors, CATALOGUE[code].advice
    if rotors is None:
        return advice
    faulty = dict.fromkeys(one.rotor for one in rotors.faults if one.code == code and one.rotor >= 0)
    return advice.replace(THIS_MOTOR, listed([rotors.names[one] for one in faulty]) or THIS_MOTOR)


def _gains_sentence(result: Result) -> str:
    """Say what `tune` recommends, as it says so itself; "" where it recommends nothing."""
    tuning = tuning_of(result)
    if len(tuning.refused) == len(tuning.axes):
        return ""
    files = f" `{on_log(result, 'tune')}` writes the files and says what to watch."
    return f"{headline(tuning)}.{files if tuning.changes else ''}"
