"""What the log shows, in words: one line for each chart, and what it lacks for the others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from quadid_logs.data.health import Health
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Direction
from quadid_logs.sentences import listed
from quadid_logs.tuning import tuning_of
from quadid_logs.untrusted import printable

#: Of each topic, what it is called.
TOPICS: Final = {
    "oscillation": "Oscillation",
    "tracking": "Rates against set-points",
    "attitude": "Angles against set-points",
    "steps": "Step response",
    "noise": "Gyro noise",
    "motors": "Motors",
    "vibration": "Vibration",
    "battery": "Battery",
}
#: Of each judgement, its colour on the page; a number without one has none.
_STYLES: Final = {"normal": "usable", "high": "caution", "severe": "refused", "fact": ""}
#: Where the recommended gains of an axis go, if it oscillates. The other ways lead nowhere that is known.
_HINTS: Final[dict[Direction, str]] = {
    "lower": "Lower its gains: the recommended ones are in `quadid-log tune`.",
    "reshape": "Change its gains as `quadid-log tune` recommends.",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthLine:
    """One topic: its name, how it was judged, and the sentence."""

    name: str
    level: str
    style: str
    sentence: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthView:
    """The chapter's texts; ``missing`` says what the log lacks for which topics."""

    lines: tuple[HealthLine, ...]
    missing: tuple[str, ...]


def health_view(result: Result) -> HealthView:
    """Put what a log shows into lines.

    Parameters
    ----------
    result : Result

    Returns
    -------
    HealthView
        Plain, visible text; not yet escaped for HTML.
    """
    health = result.health or Health()
    lines = tuple(
        HealthLine(
            name=TOPICS[name],
            level="" if topic.level == "fact" else topic.level,
            style=_STYLES[topic.level],
            sentence=printable(
                f"{topic.sentence}{_hint(result, health) if name == 'oscillation' else ''}", 600
            ),
        )
        for name, topic in health.topics.items()
    )
    return HealthView(lines=lines, missing=tuple(_missing(health)))


def _hint(result: Result, health: Health) -> str:
    """Say where the gains of oscillating axes go, if the flight tells; "" otherwise."""
    if health.oscillation is None or not health.oscillation.axes:
        return ""
    tuned = tuning_of(result).axes
    axes = dict.fromkeys(one.axis for one in health.oscillation.axes)
    hints = {axis: _HINTS.get(tuned[axis].direction, "") for axis in axes if axis in tuned}
    return "".join(f" {axis.capitalize()}: {hint}" for axis, hint in hints.items() if hint)


def _missing(health: Health) -> Iterable[str]:
    """Yield each reason once, with the topics that it keeps back."""
    reasons: dict[str, list[str]] = {}
    for name, reason in health.missing.items():
        reasons.setdefault(reason, []).append(TOPICS[name].lower())
    for reason, names in reasons.items():
        if len(names) == len(TOPICS):
            yield f"Nothing is shown of the flight: {printable(reason, 200)}."
        else:
            yield f"Not shown: {listed(names)}, for {printable(reason, 200)}."


def health_lines(result: Result) -> tuple[str, ...]:
    """Return the judged charts as lines for a terminal; numbers without a judgement stay on the page.

    Parameters
    ----------
    result : Result

    Returns
    -------
    tuple of str
        At most one for each chart.
    """
    return tuple(
        f"  {line.name.lower()}: {line.sentence}" for line in health_view(result).lines if line.level
    )
