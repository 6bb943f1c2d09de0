"""The ``health`` of result.json and of ``info --json``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np

from quadid_logs.data.health import (
    Battery,
    CommandNoise,
    Course,
    GyroSpectrum,
    Health,
    Line,
    Motors,
    Noise,
    Oscillation,
    Quantity,
    Rotors,
    Standstill,
    Steps,
    Topic,
    Tracking,
    Vibration,
)
from quadid_logs.report.strict_json import some_fields


def health_dict(health: Health) -> dict[str, Any]:
    """Return ``health``: each topic None, or its figures with a sentence.

    Topics that this version does not look at are None too.
    """
    # Rates, angles and steps, of which the first that is there says the sentence.
    parts: Mapping[str, tuple[Topic | None, Callable[[Any], dict[str, Any]]]] = {
        "rates": (health.tracking, _axes),
        "angles": (health.attitude, _axes),
        "steps": (health.steps, _steps),
    }
    found = {name: _topic(topic, figures) for name, (topic, figures) in parts.items()}
    first = next((one for one in found.values() if one is not None), None)
    return {
        "tracking": (
            None if first is None else {key: first[key] for key in ("sentence", "level", "findings")} | found
        ),
        "noise": _topic(health.noise, _noise),
        "command_noise": _topic(health.command_noise, _command_noise),
        "filters": None,
        "vibration": _topic(health.vibration, _vibration),
        "motors": _topic(health.motors, _motors),
        "rates": _topic(health.rates, _course),
        "tilt": _topic(health.tilt, _course),
        "torque": _topic(health.torque, _course),
        "throttle": _topic(health.throttle, _course),
        "thrust": _topic(health.thrust, _course),
        "battery": _topic(health.battery, _battery),
        "oscillation": _topic(health.oscillation, _oscillation),
        "rotors": _topic(health.rotors, _rotors),
        "standstill": _topic(health.standstill, _standstill),
        "missing": dict(health.missing),
    }


def _topic(topic: Any, figures: Callable[[Any], dict[str, Any]]) -> dict[str, Any] | None:
    if topic is None:
        return None
    return some_fields(topic, "sentence", "level", "findings") | figures(topic)


def _course(course: Course) -> dict[str, Any]:
    return {"figures": dict(course.figures)}


def _axes(tracking: Tracking) -> dict[str, Any]:
    return {
        "axes": tracking.axes,
        "off": tracking.off,
    }


def _steps(steps: Steps) -> dict[str, Any]:
    return {
        "axes": {
            axis: {
                **some_fields(one, "half_time", "overshoot", "overshoot_large"),
                "split": Quantity(one.split_rad_s, "rad/s"),
                "windows": {curve.size: curve.n_windows for curve in one.curves},
            }
            for axis, one in steps.axes.items()
        }
    }


def _standstill(standstill: Standstill) -> dict[str, Any]:
    return {"rotor": standstill.rotor + 1, **some_fields(standstill, "time_s", "length")}


def _line(line: Line) -> dict[str, Any]:
    return {
        "frequency": Quantity(line.frequency_hz, "Hz"),
        "height": Quantity(line.height_db, "dB"),
        "p_value": line.p_value,
        "share": Quantity(line.share, "1"),
        "rms": Quantity(line.rms, "rad/s"),
        "source": line.source.value,
        "harmonic": line.harmonic or None,
        "notch": None if np.isnan(line.notch_hz) else Quantity(line.notch_hz, "Hz"),
    }


#: Edges of the bands whose rms is given: manoeuvres, the loops, and vibration [Hz].
_BANDS_HZ: Final = (1.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def _spectrum(spectrum: GyroSpectrum | None) -> dict[str, Any] | None:
    """Return the source of a spectrum, and the rms of roll, pitch and yaw by band."""
    if spectrum is None:
        return None
    frequency_hz = spectrum.frequency_hz
    step_hz = float(frequency_hz[0])
    bands = [(low, high, (frequency_hz >= low) & (frequency_hz < high)) for low, high in pairwise(_BANDS_HZ)]
    return {
        "source": spectrum.source,
        "rate": Quantity(spectrum.rate_hz, "Hz"),
        "rms_by_band": [
            {
                "band_hz": [low, high],
                "rms": [
                    Quantity(float(value), "rad/s")
                    for value in np.sqrt(spectrum.density[inside].sum(axis=0) * step_hz)
                ],
            }
            for low, high, inside in bands
            if inside.any() and high <= frequency_hz[-1] + step_hz
        ],
    }


def _noise(noise: Noise) -> dict[str, Any]:
    return {
        "after_filters": _spectrum(noise.after),
        "before_filters": _spectrum(noise.before),
        "may_be_folded": noise.may_be_folded,
        "lines": {axis: [_line(line) for line in found] for axis, found in noise.lines.items()},
    }


def _command_noise(noise: CommandNoise) -> dict[str, Any]:
    return {
        "above": Quantity(noise.above_hz, "Hz"),
        "axes": {axis: some_fields(one, "rms", "terms") for axis, one in noise.axes.items()},
    }


def _vibration(vibration: Vibration) -> dict[str, Any]:
    return {
        "measure": vibration.measure,
        "p99": vibration.figure,
        **some_fields(vibration, "limits", "clips"),
    }


def _motors(motors: Motors) -> dict[str, Any]:
    return {
        "motors": [
            {"name": name, "mean": Quantity(mean, motors.unit), "p05": low, "p95": high}
            for name, mean, low, high in zip(
                motors.names, motors.mean.tolist(), motors.low.tolist(), motors.high.tolist(), strict=True
            )
        ],
        "spread": motors.spread,
        "hardest": motors.names[motors.hardest],
        **some_fields(motors, "headroom", "at_high", "at_low"),
    }


def _battery(battery: Battery) -> dict[str, Any]:
    return {
        "start": battery.start_v,
        "lowest": battery.lowest_v,
        "n_cells": battery.n_cells or None,
        "sag_per_tenth_throttle": battery.sag_v,
    }


def _oscillation(oscillation: Oscillation) -> dict[str, Any]:
    return {
        "searched_up_to": Quantity(oscillation.highest_hz, "Hz"),
        "may_be_folded": oscillation.may_be_folded,
        "axes": [
            {
                "axis": one.axis,
                **_line(one.line),
                "loop": one.loop.value,
                "setpoint_share": Quantity(one.setpoint_share, "1"),
                "power_share": Quantity(one.power_share, "1"),
                "output_share": Quantity(one.output_share, "1"),
                "overtone": one.overtone,
            }
            for one in oscillation.axes
        ],
    }


def _rotors(rotors: Rotors) -> dict[str, Any]:
    offset = rotors.mass_offset
    return {
        "rotors": [
            {
                "name": name,
                "effectiveness": effectiveness,
                "end_over_beginning": change,
                "shaking": shaking,
            }
            for name, effectiveness, change, shaking in zip(
                rotors.names, rotors.effectiveness, rotors.change, rotors.shaking, strict=True
            )
        ],
        "mass_offset": None if offset is None else {"forward": offset[0], "right": offset[1]},
        "thrust_change": rotors.thrust_change,
        "faults": [
            {
                "code": one.code,
                "rotor": one.rotor + 1 if one.rotor >= 0 else None,
                "time_s": None if np.isnan(one.time_s) else one.time_s,
                **some_fields(one, "size", "p_value", "sentence"),
            }
            for one in rotors.faults
        ],
        "searched": list(rotors.searched),
    }
