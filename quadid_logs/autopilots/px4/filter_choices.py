"""What of PX4's filters may be set, and the notches that the lines of a gyro ask for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final

from quadid_logs.autopilots.lines import STANDING_WIDTH, SortedLines, is_on, low_passes_on, sorted_lines
from quadid_logs.autopilots.px4.filters import ROTORS, notches_by_name
from quadid_logs.data.health import Line
from quadid_logs.data.log import FlightLog, whole_number
from quadid_logs.data.tuning import FilterChoices, written_hz

#: vehicle_angular_velocity/imu_gyro_parameters.c, @min 0 (off) and @max 1000 of IMU_GYRO_CUTOFF and
#: IMU_DGYRO_CUTOFF, as of IMU_GYRO_NF0_FRQ and NF1_FRQ; below 10 Hz a low-pass delays by more than a loop
#: bears.
_CUTOFF: Final = (10.0, 1000.0)
_SHARED: Final = ("IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF")
#: The same file, PARAM_DEFINE_FLOAT of both in the newest; older ones were lower.
_DEFAULT_HZ: Final = {"IMU_GYRO_CUTOFF": 40.0, "IMU_DGYRO_CUTOFF": 20.0}
#: The same file: @max of IMU_GYRO_NF0_BW and NF1_BW, and of IMU_GYRO_DNF_HMC, whose @min is 1; bit 0 of
#: IMU_GYRO_DNF_EN is by rotor speed.
_WIDEST_HZ: Final = 100.0
_MOST_HARMONICS: Final = 7
_STANDING: Final = ("IMU_GYRO_NF0", "IMU_GYRO_NF1")
_BY_ROTORS: Final = 1


def filter_choices(log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]) -> FilterChoices:
    """Return what may be set, see `Autopilot.filter_choices`; all axes share these filters."""
    on = low_passes_on(parameters, dict.fromkeys(_SHARED, _CUTOFF))
    return FilterChoices(
        shared=tuple({name: ends} for name, ends in on.items()),
        notches=tuple(_notches(log, parameters, sorted_lines(lines))),
        defaults=_DEFAULT_HZ,
    )


def _notches(
    log: FlightLog, parameters: Mapping[str, float], lines: SortedLines
) -> Iterator[Mapping[str, float]]:
    """Yield settings without notches that stand on nothing, and with what is missing."""
    placed = notches_by_name(parameters)
    on_line = {
        name: [line_hz for line_hz in lines.all_hz if is_on(one, line_hz)]
        for name, one in placed.items()
        if name in _STANDING
    }
    off = {f"{name}_FRQ": 0.0 for name, found in on_line.items() if not found}
    if off:
        yield off
    covered = {line_hz for found in on_line.values() for line_hz in found}
    missing = [line_hz for line_hz in lines.fixed_hz if line_hz not in covered]
    free = [name for name in _STANDING if f"{name}_FRQ" in parameters and not on_line.get(name)]
    rotors: dict[str, float] = {}
    enabled = whole_number(parameters.get("IMU_GYRO_DNF_EN"))
    if ROTORS in log.followed and "IMU_GYRO_DNF_EN" in parameters and not enabled & _BY_ROTORS:
        rotors["IMU_GYRO_DNF_EN"] = float(enabled | _BY_ROTORS)
        rotors["IMU_GYRO_DNF_HMC"] = float(min(max(lines.harmonics, default=1), _MOST_HARMONICS))
    # Where there are more lines than notches, the search tells which of them are worth one.
    for some in combinations(missing, min(len(free), len(missing))):
        on = dict(rotors)
        for name, line_hz in zip(free, some, strict=False):
            on[f"{name}_FRQ"] = written_hz(line_hz)
            on[f"{name}_BW"] = written_hz(min(STANDING_WIDTH * line_hz, _WIDEST_HZ))
        if on:
            yield off | on
