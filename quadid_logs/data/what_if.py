"""What other gains and filters would make of a loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from quadid_logs.arrays import FloatArray


class WhatIfLoop(NamedTuple):
    """Of one combination: margins of the whole loop, and the rate's answer (n_points,) to a step."""

    gain_margin_db: float | None
    phase_margin_deg: float | None
    rise_time_s: float
    overshoot_percent: float
    response: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WhatIf:
    """A grid over one axis' parameters.

    Attributes
    ----------
    values : mapping of str to tuple of float
        By parameter, the middle one as flown.
    time_s : ndarray, shape (n_points,)
        Of the responses.
    loops : tuple of (WhatIfLoop or None)
        In the order of ``itertools.product`` of the values; None where a loop is unstable.
    """

    values: Mapping[str, tuple[float, ...]]
    time_s: FloatArray
    loops: tuple[WhatIfLoop | None, ...]
