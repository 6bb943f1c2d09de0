"""INAV's Blackbox as a `FlightLog`: which fields differ from Betaflight's, and how they count.

Source: ``blackbox.c`` (``loadMainState``, ``blackboxWriteSysinfo``), ``pid.c``, ``mixer.c`` and ``imu.c`` of
INAV 9. Body axes are x forward, y left, z up. PID sums are microseconds of the outputs, which are 1000 to
2000 with digital protocols too, and the throttle is an output: ``rcCommand[3]``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.autopilots.betaflight.dialect import Dialect, Version, common_settings, fields_of
from quadid_logs.autopilots.betaflight.log import read_dialect
from quadid_logs.autopilots.betaflight.signals import SOURCES, Facts
from quadid_logs.autopilots.betaflight.sticks import straight_sticks
from quadid_logs.autopilots.sources import Part, Source, stacked
from quadid_logs.containers.blackbox import FrameTable
from quadid_logs.containers.blackbox_header import Header
from quadid_logs.data.log import FlightLog

#: Its fields of what Betaflight calls otherwise.
_FIELDS: Final = {"gyroUnfilt": "gyroRaw", "setpoint": "axisRate", "vbatLatest": "vbat"}
#: Angles are in tenths of a degree, yaw is a heading, and pitch is positive with the nose down.
_TENTH: Final = math.radians(0.1)
_TO_FRD: Final = np.array([1.0, -1.0, 1.0])
#: `rates` counts in tens of degrees per second.
_RATE_UNIT: Final = 10.0
#: Settings of Betaflight that mean something else, or nothing, here.
_NOT_ITS_OWN: Final = (
    "gyro_lowpass_hz",
    "dterm_lowpass_hz",
    "yaw_lowpass_hz",
    "rc_rates[0]",
    "rc_rates[1]",
    "tpa_mode",
)


def read(path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
    """Read a Blackbox log of INAV into canonical signals; as `read_dialect` of Betaflight's."""
    return read_dialect(DIALECT, path, system=system, number=number)


def _settings(settings: Mapping[str, float], version: Version | None) -> dict[str, float]:
    """Return settings without gains: their numbers mean other ones in Betaflight."""
    found = common_settings(settings, None)
    gains = {f"{short}_{axis}" for short in "pidf" for axis in ("roll", "pitch", "yaw")}
    return {name: value for name, value in found.items() if name not in gains | set(_NOT_ITS_OWN)}


def _facts(
    header: Header,
    settings: Mapping[str, float],
    version: Version | None,
    main: FrameTable,
    levels: BoolArray,
) -> Facts:
    found = Facts.of(header, settings, None, main, levels)
    return replace(
        found,
        throttle_range=(found.lowest_output, found.highest_output),
        has_set_points="axisRate[0]" in main.names,
        sticks=straight_sticks([_RATE_UNIT * settings.get(f"rates[{axis}]", math.nan) for axis in range(3)]),
        straight=None,
        voltage=0.01,
    )


def _attitude(part: Part[FrameTable], source: Source[Any]) -> FloatArray | None:
    """Turn tenths of a degree into rad, FRD against NED."""
    angles = stacked(part.table, source.fields, _TENTH, np.float32)
    return None if angles is None else np.asarray(angles * _TO_FRD)


def _renamed(field: str) -> str:
    name, bracket, rest = field.partition("[")
    return _FIELDS.get(name, name) + bracket + rest


def _sources() -> tuple[Source[Any], ...]:
    """Return Betaflight's table with other names, without what INAV does not log."""
    # Its navigation writes what it wants into the sticks.
    gone = ("rotor_speed", "sysid_chirp", "attitude", "stick")
    kept = (one for one in SOURCES if one.signal not in gone and one.fields != ("setpoint[3]",))
    sources = (
        replace(
            one,
            fields=tuple(map(_renamed, one.fields)),
            label=_renamed(one.label),
            reason=one.reason.replace("the stick", "sticks or navigation"),
        )
        for one in kept
    )
    attitude: Source[Any] = Source(
        "attitude", "main", tuple(f"attitude[{k}]" for k in range(3)), "the estimator's attitude", _attitude,
        label="attitude",
    )  # fmt: skip
    return (*sources, attitude)


_SOURCES: Final = _sources()
DIALECT: Final = Dialect(
    autopilot="inav",
    name="INAV",
    sources=_SOURCES,
    fields=fields_of(_SOURCES),
    unfiltered=_FIELDS["gyroUnfilt"],
    settings=_settings,
    facts=_facts,
)
