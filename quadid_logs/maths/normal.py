"""Two numbers of the normal distribution."""

from __future__ import annotations

from typing import Final

#: Half of the two-sided 95 % interval, in standard deviations.
NORMAL_95: Final = 1.959964
#: The median absolute deviation, in standard deviations.
MEDIAN_DEVIATION: Final = 0.674490
