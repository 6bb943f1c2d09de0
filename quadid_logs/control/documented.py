"""Recommended gains against the ranges that this version of the firmware documents."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from quadid_logs.data.tuning import AxisTuning, GainNames
from quadid_logs.diagnose.findings import finding

#: A gain is written to four digits.
_AT_END: Final = 1e-3


def within_documented(axis: str, tuned: AxisTuning, names: GainNames) -> AxisTuning:
    """Say of which gains the documented range is the limit, and which leave it.

    Returns
    -------
    AxisTuning
        The same gains. No gain is raised beyond its range; one that must fall for its margins falls below it.
    """
    known = {one.code for one in tuned.reasons}
    findings = []
    changed = {name: one for name, one in tuned.gains.items() if one.next != one.now}
    ranges = {name: names.ranges[name] for name in changed if name in names.ranges}
    held = {
        name: high for name, (_, high) in ranges.items() if changed[name].target >= high * (1.0 - _AT_END)
    }
    # What multiplies P, I and D takes them further, up to the end of its own range.
    if names.common and not set(names.common) & set(held):
        held = {name: high for name, high in held.items() if name == names.angle}
    below = {name: low for name, (low, _) in ranges.items() if changed[name].next < low}
    if held:
        title = f"{_words(held)} is the highest value that the firmware documents"
        findings.append(finding("QL637", "info", {"highest": held}, axes=(axis,), title=title))
    if below:
        written = {name: changed[name].next for name in below}
        ends = " and ".join(f"{value:g}" for value in below.values())
        title = f"{_words(written)} is below the lowest documented value, {ends}"
        findings.append(
            finding("QL676", "info", {"next": written, "lowest": below}, axes=(axis,), title=title)
        )
    more = [one for one in findings if one.code not in known]
    return replace(tuned, reasons=(*tuned.reasons, *more)) if more else tuned


def _words(values: dict[str, float]) -> str:
    return " and ".join(f"{name} {value:g}" for name, value in values.items())
