"""What the log shows, in words: one line for each chart, and what it lacks for the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from quadid_logs.data.catalogue import CATALOGUE, MOST_SATURATED
from quadid_logs.data.health import Health, Topic
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Direction
from quadid_logs.report.commands import on_log
from quadid_logs.sentences import listed
from quadid_logs.tuning import tuning_of
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

#: Of each topic, what it is called.
TOPICS: Final = {
    "standstill": "Motor at a standstill",
    "oscillation": "Oscillation",
    "rotors": "Rotors",
    "tracking": "Rates against set-points",
    "rates": "Rates",
    "attitude": "Angles against set-points",
    "tilt": "Tilt",
    "steps": "Step response",
    "noise": "Gyro noise",
    "command_noise": "Command noise",
    "motors": "Motors",
    "torque": "Steady torque",
    "throttle": "Throttle",
    "thrust": "Thrust",
    "vibration": "Vibration",
    "battery": "Battery",
}
#: They show what others cannot: without them nothing is missing.
_NEVER_MISSING: Final = ("standstill", "rates", "tilt", "torque", "thrust")
#: Of each judgement, its word: what is too low is not "high".
_LEVELS: Final = {"normal": "normal", "high": "not normal", "severe": "far from normal", "fact": ""}
#: Of each judgement, its colour on the page; a number without one has none.
_STYLES: Final = {"normal": "usable", "high": "caution", "severe": "refused", "fact": ""}
#: Where the recommended gains of an axis go, if it oscillates. The other ways lead nowhere that is known.
_HINTS: Final[dict[Direction, str]] = {
    "lower": "Lower its gains: `{tune}` gives the values.",
    "reshape": "Change its gains: `{tune}` gives the values.",
}
#: The mode's frequency has an error of about this.
_SAME_MODE: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthLine:
    """One topic: its name, how it was judged, and the sentence."""

    name: str
    level: str
    style: str
    sentence: str
    judged: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthView:
    """The chapter's texts; ``missing`` says what the log lacks for which topics."""

    lines: tuple[HealthLine, ...]
    missing: tuple[str, ...]


def health_view(result: Result) -> HealthView:
    """Put what a log shows into lines.

    Plain, visible text; not yet escaped for HTML.
    """
    health = result.health or Health()
    lines = tuple(
        HealthLine(
            name=TOPICS[name],
            level=_LEVELS[topic.level],
            style=_STYLES[topic.level],
            sentence=printable(
                f"{topic.sentence}{_hint(result, health) if name == 'oscillation' else _advice(topic)}", 800
            ),
            judged=topic.says_what_is_normal,
        )
        for name, topic in health.topics.items()
    )
    # Each reason once, with the topics that it keeps back.
    missing = []
    reasons: dict[str, list[str]] = {}
    for name, reason in health.missing.items():
        reasons.setdefault(reason, []).append(TOPICS[name].lower())
    for reason, names in reasons.items():
        if len(names) == len(TOPICS) - len(_NEVER_MISSING):
            missing.append(f"Nothing can be shown: {printable(reason, 200)}.")
        else:
            missing.append(f"Not shown: {listed(names)}, because {printable(reason, 200)}.")
    return HealthView(lines=lines, missing=tuple(missing))


def _advice(topic: Topic) -> str:
    """Name each finding after its sentence; what to do about a fault stands among the next steps."""
    is_fault = topic.level in ("high", "severe")
    return "".join(f" [{code}]{'' if is_fault else f' {CATALOGUE[code].advice}'}" for code in topic.findings)


def _hint(result: Result, health: Health) -> str:
    """Say where the gains of oscillating axes go, if the flight tells; "" otherwise."""
    if health.oscillation is None or not health.oscillation.axes:
        return ""
    tuned = tuning_of(result).axes
    told = []
    for axis in dict.fromkeys(one.axis for one in health.oscillation.axes):
        mine = next(one for one in health.oscillation.axes if one.axis == axis)
        hint = _HINTS.get(tuned[axis].direction, "") if axis in tuned else ""
        if axis in tuned and tuned[axis].by_rule and tuned[axis].gains:
            hint = "No model gives its gains. `{tune}` writes a first step by rule: half of the gains."
        hint = hint.format(tune=on_log(result, "tune"))
        # What predicts this frequency: the model's rate loop, a mode of the frame, or the motors' limits.
        found, hz = [], mine.line.frequency_hz
        loop = result.loop_of(mine.axis)
        margins = None if loop is None or loop.margins is None else loop.margins.rate
        figure = None if margins is None else margins.oscillation_hz
        if figure is not None and figure.ci95[0] <= hz <= figure.ci95[1]:
            found.append(f"With more gain, the model's rate loop would oscillate at {figure.value:.3g} Hz.")
        modes = [
            finding.evidence.get("frequency_hz")
            for finding in result.diagnosis.findings
            if finding.code == "QL525"
        ]
        if any(isinstance(mode, (int, float)) and abs(mode - hz) <= _SAME_MODE * hz for mode in modes):
            found.append(
                "The frame has a mode at that frequency (QL525): put a notch there, and do not reduce the "
                "filtering."
            )
        described = result.data.input
        limited = 0.0 if described is None else described.limited_fraction[AXES.index(mine.axis)]
        if limited > MOST_SATURATED:
            found.append(
                f"The mixer is at its limits in {100.0 * limited:.0f} % of the flight, which limits the "
                "size of the oscillation."
            )
        predicted = " ".join(found)
        told += [f" {axis.capitalize()}: {' '.join(filter(None, (predicted, hint)))}"] * bool(
            predicted or hint
        )
    return "".join(told)


def health_lines(result: Result) -> tuple[str, ...]:
    """Return the judged charts as lines for a terminal; numbers without a judgement stay on the page.

    At most one for each chart.
    """
    return tuple(
        f"  {line.name.lower()}: {line.sentence}" for line in health_view(result).lines if line.judged
    )
