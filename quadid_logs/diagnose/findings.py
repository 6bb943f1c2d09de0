"""How a finding is made from the catalogue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import Finding, Level


def finding(
    code: str,
    level: Level,
    evidence: Mapping[str, object],
    *,
    axes: Sequence[str] = (),
    title: str = "",
    advice: str = "",
) -> Finding:
    """Return a finding with the catalogue's title and advice unless better ones are given."""
    entry = CATALOGUE[code]
    return Finding(
        code=code,
        level=level,
        title=title or entry.title,
        evidence=dict(evidence),
        advice=advice or entry.advice,
        axes=tuple(axes),
    )
