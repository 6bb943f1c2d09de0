"""Caveats about the loop, axis by axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.control.margins import UNMODELLED_DELAY_S
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, Margins
from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.tuning import GOOD, Limits
from quadid_logs.diagnose.findings import finding, rounded

#: Small changes of the vehicle bring such loops to the limit.
POOR: Final = Limits(4.0, 30.0, 0.0)
#: Effectiveness is not known better than to some per cent in practice: less is no matter.
_DISAGREEMENT = 0.05


def find_in_loop(loop: ClosedLoop) -> Iterator[Finding]:
    """Yield the findings about the loops.

    Parameters
    ----------
    loop : ClosedLoop

    Yields
    ------
    Finding
    """
    controllers = loop.controllers
    if loop.axes and controllers.version_read != "read":
        versions = {"firmware": controllers.firmware, "version_read": controllers.version_note}
        yield finding("QL606", "info", versions)
    judged = {axis: level for axis, found in loop.axes.items() if (level := _level(outermost(found)))}
    disagreeing = {axis: both for axis, found in loop.axes.items() if (both := _disagreement(found))}
    for axis, found in loop.axes.items():
        margin = _margin(axis, loop, judged) if axis in judged else None
        disagreement = _of_two_gains(axis, disagreeing) if axis in disagreeing else None
        for one in (_not_replayed(axis, found), margin, disagreement):
            if one is not None:
                yield one
        if found.contradicted:
            yield finding("QL603", "warning", {"fitted_to_hz": rounded(found.known_hz)}, axes=(axis,))
    unchecked = [axis for axis, found in loop.axes.items() if _unchecked(found)]
    if unchecked:
        title = "The log does not show whether the controller of the parameters is the one that flew"
        yield finding("QL604", "info", {}, axes=unchecked, title=title)
    partly = [axis for axis, found in loop.axes.items() if _partly(found)]
    if partly:
        yield finding("QL642", "info", {"terms_as_logged": _as_logged(loop, partly)}, axes=partly)
    extrapolated = [axis for axis, found in loop.axes.items() if _extrapolated(found)]
    if extrapolated:
        known_hz = [rounded(loop.axes[axis].known_hz, 3) for axis in extrapolated]
        known = {"known_to_hz": known_hz, "delay_allowed_s": UNMODELLED_DELAY_S}
        yield finding("QL605", "info", known, axes=extrapolated)


def outermost(found: AxisLoop) -> Margins | None:
    """Return the margins with all that is known to close the loop; None where nothing may be said.

    Parameters
    ----------
    found : AxisLoop

    Returns
    -------
    Margins or None
    """
    return None if found.margins is None else found.margins.full or found.margins.rate


def _extrapolated(found: AxisLoop) -> bool:
    margins = outermost(found)
    return margins is not None and margins.extrapolated and not found.contradicted


def _unchecked(found: AxisLoop) -> bool:
    """Say whether margins are told of a controller that the log could not be held against."""
    replay = found.replay
    reason = None if replay is None else replay.reason
    return found.margins is not None and reason is not None and reason.tells_nothing


def _partly(found: AxisLoop) -> bool:
    """Say whether margins are told of a controller of which the replay took some terms as logged."""
    replay = found.replay
    return found.margins is not None and replay is not None and replay.agrees and bool(replay.as_logged)


def _as_logged(loop: ClosedLoop, axes: Sequence[str]) -> list[str]:
    """Return the terms that the replay of some axes took as logged."""
    replays = (loop.axes[axis].replay for axis in axes)
    return list(dict.fromkeys(term for one in replays if one is not None for term in one.as_logged))


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


def _level(margins: Margins | None) -> Level | None:
    """Judge margins by the worst of the vehicles that the flight allows; None is no finding."""
    if margins is None:
        return None
    if not margins.stable:
        return "warning"
    figures = _figures(margins).values()
    if not _below([np.inf if each is None else each.ci95[0] for each in figures], GOOD):
        return None
    return "warning" if _below(_values(margins), POOR) else "info"


def _figures(margins: Margins) -> dict[str, Estimated | None]:
    """Return the figures that `Limits` limits, in its order."""
    names = ("gain_margin_db", "phase_margin_deg", "disk_margin")
    return {name: getattr(margins, name) for name in names}


def _values(margins: Margins) -> list[float]:
    return [np.inf if each is None else each.value for each in _figures(margins).values()]


def _margin(axis: str, loop: ClosedLoop, judged: Mapping[str, Level]) -> Finding:
    """Return the finding about an axis with too little room; axes that are alike share their advice."""
    alike = [other for other in judged if judged[other] == judged[axis]]
    found = {other: margins for other in alike if (margins := outermost(loop.axes[other])) is not None}
    margins, advice = found[axis], _lower(found)
    if not margins.stable:
        title = f"With the controller of the parameters, this model of {axis} is unstable"
        evidence: dict[str, object] = {"stable_fraction": rounded(margins.stable_fraction)}
    else:
        close = "is" if _below(_values(margins), GOOD) else "may be"
        title = f"{axis.capitalize()} {close} close to instability"
        evidence = {name: _evidence(each) for name, each in _figures(margins).items() if each is not None}
    return finding("QL601", judged[axis], evidence, axes=(axis,), title=title, advice=advice)


def _lower(found: Mapping[str, Margins]) -> str:
    """Say what to change; the axes by their names, because advice is read apart from its finding."""
    percents = {axis: _percent_left(margins) for axis, margins in found.items()}
    to_percent = [f"{axis} to at most {left} %" for axis, left in percents.items() if left]
    others = " and ".join(axis for axis, left in percents.items() if not left)
    if to_percent:
        also = f", and those of {others}" if others else ""
        leaves = f"of what they are, for a gain margin of {GOOD.gain_db:g} dB{also}"
        what = f"together: {', '.join(to_percent)} {leaves}"
    else:
        what = f"of {others} together"
    return (
        f"Lower P, I and D {what}; or let the filters of gyro and derivative pass more where noise allows "
        "it. `quadid-log tune` works out both and writes the parameters. Land if the vehicle oscillates."
    )


def _percent_left(margins: Margins) -> str:
    """Return what is left of gains that leave the gain margin that is enough, "" where they have it."""
    gain = margins.gain_margin_db
    if not margins.stable or gain is None or gain.ci95[0] >= GOOD.gain_db:
        return ""
    return f"{100.0 * 10.0 ** ((gain.ci95[0] - GOOD.gain_db) / 20.0):.0f}"


def _below(values: list[float], limits: Limits) -> bool:
    return any(value < limit for value, limit in zip(values, limits, strict=True))


def _evidence(figure: Estimated) -> dict[str, object]:
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
    first, second = (_evidence(each) for each in disagreeing[axis])
    *others, last = disagreeing
    named = f"{', '.join(others)} and {last}" if others else last
    advice = f"Check that no gain of {named} was changed in flight, and fly stronger manoeuvres in calm air."
    title = f"Open loop and closed loop tell different effectiveness of {axis}"
    evidence = {"open_loop": first, "closed_loop": second}
    return finding("QL602", "warning", evidence, axes=(axis,), title=title, advice=advice)
