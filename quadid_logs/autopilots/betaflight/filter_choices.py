"""What of Betaflight's filters may be set, and whether the RPM filter is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from quadid_logs.autopilots.betaflight.filters import (
    D_LOW_PASSES,
    GYRO_LOW_PASSES,
    LowPassNames,
    has_rpm_notches,
)
from quadid_logs.autopilots.lines import sorted_lines
from quadid_logs.data.health import Line
from quadid_logs.data.log import FlightLog
from quadid_logs.data.tuning import Cutoffs, FilterChoices

#: ``sensors/gyro.h``, LPF_MAX_HZ and DYN_LPF_MAX_HZ, which ``cli/settings.c`` takes for low-passes of gyro
#: and D from 0, off, up; below 30 Hz a cut-off delays by more than a loop bears.
_CUTOFF: Final = (30.0, 1000.0)
#: ``cli/settings.c``, PARAM_NAME_RPM_FILTER_HARMONICS: 0 to 3, where 0 is off.
_HARMONICS: Final = 3


def filter_choices(log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]) -> FilterChoices:
    """Return what may be set, see `Autopilot.filter_choices`; all axes share these filters.

    The low-passes of the gyro go together, and those of D.
    """
    both = (_ranges(parameters, names) for names in (GYRO_LOW_PASSES, D_LOW_PASSES))
    harmonics = sorted_lines(lines).harmonics
    missing = harmonics and parameters.get("dshot_bidir", 0.0) > 0.0 and not has_rpm_notches(parameters)
    on = {"rpm_filter_harmonics": float(min(max(harmonics), _HARMONICS))} if missing else {}
    return FilterChoices(
        shared=tuple(each for each in both if each),
        notches=(on,) if on and "rpm_filter_harmonics" in parameters else (),
    )


def _ranges(parameters: Mapping[str, float], low_passes: Sequence[LowPassNames]) -> Cutoffs:
    """Return the settings that make the cut-offs of low-passes: ends of a range, or one that stands."""
    found: dict[str, tuple[float, float]] = {}
    for names in low_passes:
        if names.dynamic and parameters.get(f"{names.dynamic}[0]", 0.0) > 0.0:
            found |= {f"{names.dynamic}[{end}]": _CUTOFF for end in (0, 1)}
        elif parameters.get(names.static, 0.0) > 0.0:
            found[names.static] = _CUTOFF
    return found
