"""What all controllers are read with: the version whose source was read, and parameters by short names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from quadid_logs.data.controller import VersionRead


def read_version(
    version: tuple[int, ...] | None, known: Sequence[tuple[int, int]]
) -> tuple[VersionRead, str]:
    """Tell whether a version's source was read, and name the one that stands for it.

    Parameters
    ----------
    version : tuple of int or None
        Of the log's firmware, most significant first; None where it is not told.
    known : sequence of (int, int)
        Versions that were read.

    Returns
    -------
    version_read : str
        As of `FlownControllers`.
    note : str
        The version that was read, for example "4.7".

    Examples
    --------
    >>> read_version((4, 5, 7), [(4, 2), (4, 7)])
    ('nearest', '4.7')
    """
    if version is None:
        return "unknown", _words(max(known))
    own = (version[0], version[1])
    # A change of the first number outweighs any of the second.
    nearest = min(known, key=lambda one: (abs(one[0] - own[0]), abs(one[1] - own[1])))
    return ("read" if nearest == own else "nearest"), _words(nearest)


def finite(value: float | None) -> float | None:
    """Return a parameter's value, None where a damaged log makes it no number."""
    return value if value is not None and math.isfinite(value) else None


def by_short_names(
    parameters: Mapping[str, float], prefix: str, needed: Sequence[str], optional: Mapping[str, float]
) -> dict[str, float]:
    """Return the parameters of one axis' controller by what follows the prefix of their names.

    Parameters
    ----------
    optional : mapping of str to float
        With the values of those that are missing, or no number in a damaged log.

    Raises
    ------
    KeyError
        If one of those needed is missing.
    """
    found = {short: parameters[prefix + short] for short in needed}
    rest = {short: finite(parameters.get(prefix + short)) for short in optional}
    return found | {short: optional[short] if value is None else value for short, value in rest.items()}


def gains_named(names: Sequence[str], parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Return the parameters of roll, pitch and yaw with these names; None where one is missing."""
    if any(name not in parameters for name in names):
        return None
    roll, pitch, yaw = (parameters[name] for name in names)
    return roll, pitch, yaw


def _words(version: tuple[int, int]) -> str:
    return ".".join(str(number) for number in version)
