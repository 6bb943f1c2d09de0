"""How far loops are from instability, in levels: the one place where margins are held against the limits."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from quadid_logs.control.scaled_loop import spare
from quadid_logs.data.closed_loop import AxisLoop, Estimated, LoopMargins, Margins
from quadid_logs.data.tuning import GOOD, POOR, AxisTuning, Limits


class Room(IntEnum):
    """What a loop has beside its limits, the least first."""

    UNSTABLE = 0
    #: Below the poor limits, as estimated.
    POOR = 1
    #: Below the limits, as estimated.
    LITTLE = 2
    #: Below the limits in the worst of the vehicles that the flight allows.
    PERHAPS_LITTLE = 3
    ENOUGH = 4


def figures(margins: Margins) -> dict[str, tuple[Estimated | None, str]]:
    """Return by name each figure that is limited, with the field of `Limits` that limits it.

    Returns
    -------
    dict of str to (Estimated or None, str)
    """
    return {
        "gain_margin_db": (margins.gain_margin_db, "gain_db"),
        "gain_margin_down_db": (margins.gain_margin_down_db, "gain_db"),
        "phase_margin_deg": (margins.phase_margin_deg, "phase_deg"),
        "disk_margin": (margins.disk_margin, "disk"),
    }


def room_of(margins: Margins, limits: Limits = GOOD) -> Room:
    """Judge a loop by its limits.

    Parameters
    ----------
    margins : Margins
    limits : Limits
        Below which a loop has too little.
    """
    if not margins.stable:
        return Room.UNSTABLE
    if _least(margins, POOR, worst=False) < 0.0:
        return Room.POOR
    if _least(margins, limits, worst=False) < 0.0:
        return Room.LITTLE
    return Room.PERHAPS_LITTLE if _least(margins, limits, worst=True) < 0.0 else Room.ENOUGH


def _least(margins: Margins, limits: Limits, *, worst: bool) -> float:
    """Return what is left of the least figure above its limit, of the estimate or of the worst vehicle."""
    pairs = ((figure, getattr(limits, limit)) for figure, limit in figures(margins).values() if figure)
    return min(((each.ci95[0] if worst else each.value) - limit for each, limit in pairs), default=np.inf)


def outermost(found: AxisLoop) -> Margins | None:
    """Return the margins with all that is known to close the loop; None where nothing may be said."""
    return None if found.margins is None else whole(found.margins)


def whole(margins: LoopMargins) -> Margins:
    """Return the margins with the angle loop where that is known."""
    return margins.full or margins.rate


def leads_back(before: LoopMargins, after: LoopMargins, limits: Limits = GOOD) -> bool:
    """Say whether the gains before are a remedy where those after make the vehicle shake.

    What can be seen and heard is an oscillation at the upper end of the loop: gains that leave it more of a
    gain margin there damp it. None lead back into a loop that is itself close to instability.
    """
    calmer = _up_db(before) >= _up_db(after)
    return calmer and (room_of(whole(before)) > Room.POOR or spare(before, limits) >= spare(after, limits))


def _up_db(margins: LoopMargins) -> float:
    """Return by how much the gain of a loop may grow; minus infinity where it is unstable."""
    outer = whole(margins)
    if not outer.stable:
        return -np.inf
    return np.inf if outer.gain_margin_db is None else outer.gain_margin_db.value


def has_way_back(found: AxisTuning, limits: Limits) -> bool:
    """Say whether the flown gains are the way back from the next ones.

    Returns
    -------
    bool
        False, too, where nothing changes.
    """
    if found.by_rule:
        return True  # they flew, and less gain may not hold every vehicle
    return found.now is not None and found.next is not None and leads_back(found.now, found.next, limits)


def missed(margins: LoopMargins, limits: Limits) -> tuple[str, ...]:
    """Return the limits that the worst vehicles do not keep.

    Parameters
    ----------
    margins : LoopMargins
        Of the rate loop, and with the angle loop.
    limits : Limits

    Returns
    -------
    tuple of str
        Fields of `Limits`, in its order; all of them where a loop is unstable.
    """
    loops = [one for one in (margins.rate, margins.full) if one is not None]
    if not all(one.stable for one in loops):
        return limits._fields
    pairs = [pair for one in loops for pair in figures(one).values()]
    below = {name for each, name in pairs if each is not None and each.ci95[0] < getattr(limits, name)}
    return tuple(name for name in limits._fields if name in below)
