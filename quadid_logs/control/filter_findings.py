"""What is said of filters that are changed with the gains."""

from __future__ import annotations

from collections.abc import Mapping

from quadid_logs.control.filter_design import Changes
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.tuning import GainChange
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.sentences import listed


def filter_findings(axis: str, filters: Mapping[str, GainChange], chosen: Changes) -> list[Finding]:
    """Return why filters are changed: what that brings, and what was wrong with those that flew.

    Parameters
    ----------
    axis : str
    filters : mapping of str to GainChange
        By parameter, NaN where the log does not hold the flown value.
    chosen : Changes

    Returns
    -------
    list of Finding
        The decisive one first.
    """
    told = {
        "attitude_error_ratio": rounded(chosen.cost[axis], 3),
        "torque_noise_ratio": rounded(chosen.noise[axis], 3),
    }
    found = [finding("QL670", "info", told, axes=(axis,))]
    cutoffs = {name: one for name, one in filters.items() if name in chosen.cutoffs}
    opened = {name: one for name, one in cutoffs.items() if one.next > one.now}
    closed = {name: one for name, one in cutoffs.items() if one.next < one.now}
    notches = {name: one.next for name, one in filters.items() if name not in cutoffs}
    # Both ways at once is neither too much nor too little.
    if opened and not closed:
        found.append(
            finding("QL671", "info", _hertz(opened), axes=(axis,), title=_title("much", opened, axis))
        )
    if closed and not opened and chosen.noise[axis] < 1.0:
        found.append(
            finding("QL672", "info", _hertz(closed), axes=(axis,), title=_title("little", closed, axis))
        )
    if notches:
        found.append(finding("QL673", "info", {"settings": notches}, axes=(axis,)))
    return found


def _hertz(changes: Mapping[str, GainChange]) -> dict[str, object]:
    return {"parameters": list(changes), "from_hz": [one.now for one in changes.values()]}


def _title(amount: str, changes: Mapping[str, GainChange], axis: str) -> str:
    moved = listed([f"{name} from {one.now:g} to {one.next:g} Hz" for name, one in changes.items()])
    return f"There is too {amount} filtering for {axis}: set {moved}"
