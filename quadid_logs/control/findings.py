"""Caveats about the loop, axis by axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from quadid_logs.control.margins import MOST_UNMODELLED_DEG
from quadid_logs.control.room import Room, figures, outermost, room_of
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.tuning import GOOD
from quadid_logs.diagnose.findings import finding, rounded

_TITLES: Final = {
    Room.UNSTABLE: "The {axis} loop is unstable in the model with the controller of the parameters",
    Room.POOR: "{Axis} is close to instability",
    Room.LITTLE: "{Axis} has less margin than required",
    Room.PERHAPS_LITTLE: "{Axis} may have less margin than required",
}
#: The same for all axes, so that it is one step of what to do next.
_CLOSE: Final = (
    "Watch this axis in the next flight: the loop may oscillate. Land if the vehicle shakes or the motors "
    f"buzz. {CATALOGUE['QL601'].advice}"
)
#: Effectiveness is not known better than to some per cent in practice: less is no matter.
_DISAGREEMENT = 0.05


def find_in_loop(loop: ClosedLoop) -> Iterator[Finding]:
    """Yield the findings about the loops."""
    controllers = loop.controllers
    if loop.axes and controllers.version_read != "read":
        versions = {"firmware": controllers.firmware, "version_read": controllers.version_note}
        yield finding("QL606", "info", versions)
    disagreeing = {axis: both for axis, found in loop.axes.items() if (both := _disagreement(found))}
    unchecked, partly, extrapolated = [], [], []
    for axis, found in loop.axes.items():
        disagreement = _of_two_gains(axis, disagreeing) if axis in disagreeing else None
        for one in (_not_replayed(axis, found), _margin(axis, found), disagreement, _line(axis, found)):
            if one is not None:
                yield one
        if found.contradicted:
            yield finding("QL603", "warning", {}, axes=(axis,))
        replay, margins = found.replay, outermost(found)
        if found.margins is not None and replay is not None:
            # The log could not be held against the controller, or the replay took some terms as logged.
            if replay.reason is not None and replay.reason.tells_nothing:
                unchecked.append(axis)
            if replay.agrees and replay.as_logged:
                partly.append((axis, replay.as_logged))
        if margins is not None and margins.extrapolated and not found.contradicted:
            extrapolated.append(axis)
    if unchecked:
        title = "The log does not show whether the controller flew with the logged parameters"
        yield finding("QL604", "info", {}, axes=unchecked, title=title)
    if partly:
        terms = list(dict.fromkeys(term for _, as_logged in partly for term in as_logged))
        yield finding("QL642", "info", {"terms_as_logged": terms}, axes=[axis for axis, _ in partly])
    if extrapolated:
        known_hz = [rounded(loop.axes[axis].known_hz, 3) for axis in extrapolated]
        known = {"known_to_hz": known_hz, "phase_allowed_deg": rounded(MOST_UNMODELLED_DEG, 2)}
        yield finding("QL605", "info", known, axes=extrapolated)


def _line(axis: str, found: AxisLoop) -> Finding | None:
    """Return the finding about a mode that the spectrum of the rate shows."""
    margins, frame = outermost(found), found.frame
    if margins is None or frame is None or not frame.seen:
        return None
    gain = margins.gain_margin_db
    evidence: dict[str, object] = {
        "frequency_hz": rounded(frame.line_hz, 3),
        "power_over_surroundings": rounded(frame.line_height, 3),
        "probability_of_none": rounded(frame.absent, 2),
    }
    if gain is not None:
        evidence["gain_margin_db"] = as_evidence(gain)
    low = gain is not None and gain.ci95[0] < GOOD.gain_db
    line = f"{rounded(frame.line_hz, 3):g} Hz about {axis}"
    advice = (
        f"Look for what bends or is loose at {line}, and stiffen it. Or put a notch there, if a log at the "
        "loop rate shows the peak too. Do not raise P or D before that."
    )
    # A loop near its limit makes a line of its own where it would oscillate; what bends takes margin, too.
    if (room := room_of(margins)) < Room.ENOUGH:
        has = "has" if room <= Room.POOR else "may have"
        advice = (
            f"The peak at {line} may be the loop itself, which {has} little margin. Do not raise P or D: fly "
            "with more margin first. If the peak stays, look for what bends or is loose, and stiffen it. "
            "Or put a notch there, if a log at the loop rate shows the peak too."
        )
    return finding("QL607", "warning" if low else "info", evidence, axes=(axis,), advice=advice)


def _not_replayed(axis: str, found: AxisLoop) -> Finding | None:
    replay = found.replay
    if replay is None or replay.agrees or replay.reason is None:
        return None
    if replay.reason.tells_nothing:
        return None
    differs = f" ({replay.parameter})" if replay.parameter else ""
    title = (
        f"The {axis} controller of the parameters is not the one that flew: {replay.reason.value}{differs}"
    )
    errors = {f"{term}_relative_rms": rounded(value) for term, value in replay.relative_rms.items() if value}
    numbers = {name: rounded(value) for name, value in replay.numbers.items()}
    return finding("QL604", "warning", {**errors, **numbers}, axes=(axis,), title=title)


def _margin(axis: str, found: AxisLoop) -> Finding | None:
    """Return the finding about an axis with too little margin; which gains have more, `tune` alone says."""
    margins = outermost(found)
    # Of a loop that the measured response contradicts no margin is told.
    if margins is None or found.contradicted or (room := room_of(margins)) is Room.ENOUGH:
        return None
    close = room <= Room.POOR
    title = _TITLES[room].format(axis=axis, Axis=axis.capitalize())
    evidence: dict[str, object] = {
        name: as_evidence(each) for name, (each, _) in figures(margins).items() if each is not None
    }
    if not margins.stable:
        evidence = {"stable_fraction": rounded(margins.stable_fraction)}
    return finding(
        "QL601",
        "warning" if close else "info",
        evidence,
        axes=(axis,),
        title=title,
        advice=_CLOSE if close else "",
    )


def as_evidence(figure: Estimated) -> dict[str, object]:
    """Return a figure and its interval, each by its name."""
    return {"value": rounded(figure.value, 3), "ci95": [rounded(end, 3) for end in figure.ci95]}


def _disagreement(found: AxisLoop) -> tuple[Estimated, Estimated] | None:
    """Return the effectiveness found from torque and rates and that of the closed loop, if they differ."""
    if found.prediction is None or found.effectiveness is None or found.prediction.at_limits:
        return None
    first, second = found.effectiveness, found.prediction.effectiveness
    difference = abs(second.value - first.value)
    half_widths = [0.5 * (each.ci95[1] - each.ci95[0]) for each in (first, second)]
    allowed = float(np.linalg.norm(half_widths))
    return (first, second) if difference > max(allowed, _DISAGREEMENT * first.value) else None


def _of_two_gains(axis: str, disagreeing: Mapping[str, tuple[Estimated, Estimated]]) -> Finding:
    """Return the finding about an axis; all share their advice, which names them: it is read apart."""
    first, second = (as_evidence(each) for each in disagreeing[axis])
    *others, last = disagreeing
    named = f"{', '.join(others)} and {last}" if others else last
    advice = f"Check that no gain of {named} was changed in flight. Fly the manoeuvres again, in calm air."
    title = f"The open-loop and the closed-loop estimate of the {axis} effectiveness disagree"
    evidence = {"open_loop": first, "closed_loop": second}
    return finding("QL602", "warning", evidence, axes=(axis,), title=title, advice=advice)
