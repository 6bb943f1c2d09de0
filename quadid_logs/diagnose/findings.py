"""How a finding is made from the catalogue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from quadid_logs.data.catalogue import CATALOGUE, Step
from quadid_logs.data.diagnosis import Finding, Level


def finding(
    code: str,
    level: Level,
    evidence: Mapping[str, object],
    *,
    axes: Sequence[str] = (),
    title: str = "",
    advice: str = "",
    step: Step | None = None,
) -> Finding:
    """Return a finding with the catalogue's title and advice unless better ones are given.

    Parameters
    ----------
    code : str
        A key of the catalogue.
    level : "info", "warning" or "error"
    evidence : mapping of str to object
        What it rests on: units at the end of the keys, values that JSON knows.
    axes : sequence of str
        The axes that it touches; empty means all.
    title, advice : str
        "" takes the catalogue's.
    step : "set", "fly" or "other", optional
        What the advice is; None takes the catalogue's.

    Returns
    -------
    Finding
    """
    entry = CATALOGUE[code]
    return Finding(
        code=code,
        level=level,
        title=title or entry.title,
        evidence=dict(evidence),
        advice=advice or entry.advice,
        axes=tuple(axes),
        step=step,
    )


def rounded(value: float, digits: int = 4) -> float:
    """Return so many significant digits: evidence is read by people.

    Parameters
    ----------
    value : float
    digits : int

    Returns
    -------
    float

    Examples
    --------
    >>> rounded(1234.567), rounded(0.0123456, 3)
    (1235.0, 0.0123)
    """
    return float(f"{value:.{digits}g}")
