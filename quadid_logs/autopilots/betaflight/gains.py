"""Betaflight's gains: names of the command line, ranges, and what is not told."""

from __future__ import annotations

from collections.abc import Mapping

from quadid_logs.autopilots.betaflight.advice import SLIDERS
from quadid_logs.autopilots.betaflight.filters import D_LOW_PASSES, GYRO_LOW_PASSES
from quadid_logs.data.tuning import GainNames, Tunable
from quadid_logs.vocabulary import AXES

#: ``pid.h``, PID_GAIN_MAX: raised with the simplified tuning of 4.3.
_HIGHEST, _HIGHEST_BEFORE = 250.0, 200.0


def tunable(parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
    """Return the gains that may be changed.

    P, I and D are scaled together, and with D the other end of its range. Feed-forward is no part of the
    loop, and stays.
    """
    curved = parameters.get("tpa_curve_type", 0.0) != 0.0
    highest = _HIGHEST if SLIDERS in parameters else _HIGHEST_BEFORE
    axes = {}
    for axis in AXES:
        proportional, integral, derivative = (f"{short}_{axis}" for short in "pid")
        ends = [
            f"{name}_{axis}" for name in ("d_min", "d_max") if parameters.get(f"{name}_{axis}", 0.0) > 0.0
        ]
        scaled = (proportional, integral, derivative, *ends)
        axes[axis] = GainNames(
            scaled=scaled,
            proportional=proportional,
            integral=integral,
            derivative=derivative,
            angle="",
            filters=("dterm_lpf2_static_hz", "gyro_lpf2_static_hz"),
            low_passes=tuple(one.static for one in (*GYRO_LOW_PASSES, *D_LOW_PASSES)),
            ranges=dict.fromkeys(scaled, (0.0, highest)),
            whole=True,
        )
    return Tunable(
        axes=axes,
        obstacle="flown with a throttle attenuation curve that is not modelled (tpa_curve_type)"
        if curved
        else "",
    )
