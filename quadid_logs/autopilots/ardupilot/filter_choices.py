"""What of ArduPilot's filters may be set, and the notches that the lines of a gyro ask for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES
from quadid_logs.autopilots.ardupilot.filters import notch_sets
from quadid_logs.autopilots.ardupilot.followed import CENTRES, ROTORS
from quadid_logs.autopilots.lines import STANDING_WIDTH, SortedLines, is_on, low_passes_on, sorted_lines
from quadid_logs.data.health import Line
from quadid_logs.data.log import FlightLog, Places
from quadid_logs.data.tuning import FilterChoices, written_hz

#: AP_InertialSensor/AP_InertialSensor.cpp, @Range of GYRO_FILTER: 0 256, where 0 is off; below 10 Hz it
#: delays by more than a loop bears.
_GYRO: Final = (10.0, 256.0)
#: AC_AttitudeControl/AC_AttitudeControl_Multi.cpp, @Range: RAT_RLL_FLTD 5 100, FLTE 0 100; RAT_YAW_FLTD
#: 5 50, FLTE 0 20. There 0 is off, and what is on stays on.
_OWN: Final = {"FLTD": (5.0, 100.0), "FLTE": (1.0, 100.0)}
_OWN_OF_YAW: Final = {"FLTD": (5.0, 50.0), "FLTE": (1.0, 20.0)}
#: Defaults of copters: DEFAULT_GYRO_FILTER of AP_InertialSensor.cpp, AC_ATC_MULTI_RATE_RPY_FILT_HZ of
#: AC_AttitudeControl_Multi.h.
_DEFAULT_HZ: Final = {"INS_GYRO_FILTER": 20.0} | {
    f"ATC_RAT_{name}_FLTD": 20.0 for name in AXIS_NAMES.values()
}
#: Filter/HarmonicNotchFilter.cpp, @Range: FREQ 10 495, BW 5 250; 40 dB is the default of ATT. HMNCS has a
#: bit for each harmonic, at least seven of them (HarmonicNotchFilter.h, AP_Int8), REF is 0 to 1.
_FREQUENCY: Final = (10.0, 495.0)
_WIDTH: Final = (5.0, 250.0)
_DEPTH_DB: Final = 40.0
#: The width that the firmware's documentation gives a notch that moves: half its frequency.
_WIDTH_MOVING: Final = 0.5
#: INS_HNTCH_MODE.
_FIXED, _THROTTLE, _ESC = 0, 1, 3
#: The first has a number in the log; the second came with 4.2.
_SETS: Final = ("INS_HNTCH", "INS_HNTC2")
#: A notch that follows the rotors has its lowest place a little below the slowest that they turned.
_SLOWEST: Final = 0.05
_BELOW: Final = 0.9


def filter_choices(log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]) -> FilterChoices:
    """Return what may be set; see `Autopilot.filter_choices`."""
    shared = low_passes_on(parameters, {"INS_GYRO_FILTER": _GYRO})
    return FilterChoices(
        shared=(shared,) if shared else (),
        own={
            axis: tuple(
                found
                for short, ends in (_OWN_OF_YAW if axis == "yaw" else _OWN).items()
                if (found := low_passes_on(parameters, {f"ATC_RAT_{name}_{short}": ends}))
            )
            for axis, name in AXIS_NAMES.items()
        },
        notches=tuple(_notches(log, parameters, sorted_lines(lines))),
        defaults=_DEFAULT_HZ,
    )


def _notches(
    log: FlightLog, parameters: Mapping[str, float], lines: SortedLines
) -> Iterator[Mapping[str, float]]:
    """Yield settings of both sets: without a notch that stands on nothing, and with what is missing."""
    available = [name for name in _SETS if f"{name}_ENABLE" in parameters]
    used = [name for name in available if parameters[f"{name}_ENABLE"] == 1.0]
    placed = notch_sets(parameters, log.followed, log.version)
    # Of a set whose places nobody knows nothing is said, and what one that moves takes away is in no log.
    idle = [
        name
        for name in used
        if name in placed
        and parameters.get(f"{name}_MODE", _FIXED) == _FIXED
        and not any(
            is_on(one, line_hz) for notches in placed[name] for one in notches for line_hz in lines.all_hz
        )
    ]
    off = {f"{name}_ENABLE": 0.0 for name in idle}
    if off:
        yield off
    free = [name for name in available if name not in used or name in idle]
    covered = [name for name in used if name in placed and name not in idle]
    missing = [
        one for one in _wanted(log, parameters, lines) if not _is_covered(one, parameters, covered, placed)
    ]
    # The log tells where a notch stood that moved: such a set is not set to something else.
    usable = [name for name in free if name in _SETS and CENTRES[_SETS.index(name)] not in log.followed]
    # Where there are more lines than sets, the search tells which of them are worth one.
    for some in combinations(missing, min(len(usable), len(missing))):
        chosen = dict(zip(usable, some, strict=False))
        on = {
            f"{name}_{short}": value for name, setting in chosen.items() for short, value in setting.items()
        }
        if on:
            yield off | on


def _is_covered(
    wanted: Mapping[str, float],
    parameters: Mapping[str, float],
    used: Sequence[str],
    placed: Mapping[str, Places],
) -> bool:
    """Tell whether a set that is on does what another would: it follows the same, or stands there."""
    if wanted["MODE"] != _FIXED:
        return any(parameters.get(f"{name}_MODE", _FIXED) != _FIXED for name in used)
    return any(is_on(one, wanted["FREQ"]) for name in used for notches in placed[name] for one in notches)


def _wanted(
    log: FlightLog, parameters: Mapping[str, float], lines: SortedLines
) -> Iterator[dict[str, float]]:
    """Yield the notches that the lines ask for, those of the rotors first."""
    rotors_hz = log.followed.get(ROTORS)
    hover = parameters.get("MOT_THST_HOVER", 0.0)
    if rotors_hz is not None:
        mean_hz = rotors_hz.mean(axis=1)
        lowest_hz = (
            _BELOW * float(np.quantile(mean_hz[mean_hz > 0.0], _SLOWEST)) if (mean_hz > 0.0).any() else 0.0
        )
        # Where rotors change their speed much, their line is none: the search tells what a notch is worth.
        mask = sum(1 << (harmonic - 1) for harmonic in lines.harmonics or (1,))
        yield from _setting(lowest_hz, _WIDTH_MOVING, _ESC, 1.0, mask)
    elif lines.by_throttle_hz and 0.0 < hover < 1.0:
        yield from _setting(min(lines.by_throttle_hz), _WIDTH_MOVING, _THROTTLE, hover, 1)
    for line_hz in lines.fixed_hz:
        yield from _setting(line_hz, STANDING_WIDTH, _FIXED, 0.0, 1)


def _setting(
    frequency_hz: float, width: float, mode: int, reference: float, harmonics: int
) -> Iterator[dict[str, float]]:
    """Yield the parameters of one set, none where the firmware does not take them."""
    if not _FREQUENCY[0] <= frequency_hz <= _FREQUENCY[1]:
        return
    placed_hz = written_hz(frequency_hz)
    yield {
        "ENABLE": 1.0,
        "MODE": float(mode),
        "FREQ": placed_hz,
        "BW": written_hz(float(np.clip(width * placed_hz, *_WIDTH))),
        "ATT": _DEPTH_DB,
        "HMNCS": float(harmonics),
        **({} if mode == _FIXED else {"REF": float(round(reference, 3))}),
    }
