"""Numbers of the normal distribution, and of 95 % intervals."""

from __future__ import annotations

from typing import Final

#: Half of the two-sided 95 % interval, in standard deviations.
NORMAL_95: Final = 1.959964
#: The median absolute deviation, in standard deviations.
MEDIAN_DEVIATION: Final = 0.674490
#: The quantiles at which a two-sided 95 % interval of drawn values ends.
ENDS_95: Final = (0.025, 0.975)
