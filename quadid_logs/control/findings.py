"""Caveats about the loop, axis by axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from quadid_logs.control.margins import UNMODELLED_DELAY_S
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, Margins
from quadid_logs.data.controller import ReplayReason
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
    for axis, found in loop.axes.items():
        for one in (_not_replayed(axis, found), _margin(axis, found), _disagreement(axis, found)):
            if one is not None:
                yield one
        if found.contradicted:
            yield finding("QL603", "warning", {"fitted_to_hz": rounded(found.known_hz)}, axes=(axis,))
    unchecked = [axis for axis, found in loop.axes.items() if _unchecked(found)]
    if unchecked:
        title = "The log does not show whether the controller of the parameters is the one that flew"
        yield finding("QL604", "info", {}, axes=unchecked, title=title)
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
    return found.margins is not None and replay is not None and replay.reason is ReplayReason.NO_ROWS


def _not_replayed(axis: str, found: AxisLoop) -> Finding | None:
    replay = found.replay
    if replay is None or replay.agrees or replay.reason is None:
        return None
    if replay.reason is ReplayReason.NO_ROWS:
        return None
    differs = f" ({replay.parameter})" if replay.parameter else ""
    title = (
        f"The {axis} controller of the parameters is not the one that flew: {replay.reason.value}{differs}"
    )
    errors = {f"{term}_relative_rms": rounded(value) for term, value in replay.relative_rms.items() if value}
    numbers = {name: rounded(value) for name, value in replay.numbers.items()}
    return finding("QL604", "warning", {**errors, **numbers}, axes=(axis,), title=title)


def _margin(axis: str, found: AxisLoop) -> Finding | None:
    """Judge the margins of one axis by what they are in the worst of the vehicles that the flight allows."""
    margins = outermost(found)
    if margins is None:
        return None
    if not margins.stable:
        title = f"With the controller of the parameters, this model of {axis} is unstable"
        fraction = {"stable_fraction": rounded(margins.stable_fraction)}
        return finding("QL601", "warning", fraction, axes=(axis,), title=title, advice=_lower(axis, None))
    figures = (margins.gain_margin_db, margins.phase_margin_deg, margins.disk_margin)
    worst = [np.inf if each is None else each.ci95[0] for each in figures]
    if not _below(worst, GOOD):
        return None
    values = [np.inf if each is None else each.value for each in figures]
    poor = _below(values, POOR)
    title = f"{axis.capitalize()} {'is' if _below(values, GOOD) else 'may be'} close to instability"
    evidence: dict[str, object] = {
        name: _evidence(each)
        for name, each in zip(("gain_margin_db", "phase_margin_deg", "disk_margin"), figures, strict=True)
        if each is not None
    }
    level: Level = "warning" if poor else "info"
    advice = _lower(axis, margins.gain_margin_db)
    return finding("QL601", level, evidence, axes=(axis,), title=title, advice=advice)


def _lower(axis: str, gain_margin_db: Estimated | None) -> str:
    """Say what to change; the axis by its name, because advice is read apart from its finding."""
    by = ""
    if gain_margin_db is not None and gain_margin_db.ci95[0] < GOOD.gain_db:
        factor = 10.0 ** ((gain_margin_db.ci95[0] - GOOD.gain_db) / 20.0)
        by = f" to {100.0 * factor:.0f} % of what they are, which leaves {GOOD.gain_db:g} dB,"
    return (
        f"Lower P, I and D of {axis} together{by} or let the filters of gyro and derivative pass more where "
        "noise allows it; `quadid-log tune` works out both and writes the parameters. Land if the vehicle "
        "oscillates."
    )


def _below(values: list[float], limits: Limits) -> bool:
    return any(value < limit for value, limit in zip(values, limits, strict=True))


def _evidence(figure: Estimated) -> dict[str, object]:
    """Return a figure and its interval, each by its name."""
    return {"value": rounded(figure.value, 3), "ci95": [rounded(end, 3) for end in figure.ci95]}


def _disagreement(axis: str, found: AxisLoop) -> Finding | None:
    """Compare the effectiveness found from torque and rates with that of the closed loop."""
    if found.prediction is None or found.effectiveness is None:
        return None
    first, second = found.effectiveness, found.prediction.effectiveness
    difference = abs(second.value - first.value)
    half_widths = [0.5 * (each.ci95[1] - each.ci95[0]) for each in (first, second)]
    allowed = float(np.linalg.norm(half_widths))
    if difference <= max(allowed, _DISAGREEMENT * first.value):
        return None
    evidence = {"open_loop": _evidence(first), "closed_loop": _evidence(second)}
    return finding("QL602", "warning", evidence, axes=(axis,))
