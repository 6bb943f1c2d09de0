"""The names of evidence, signals and units as people say them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from quadid_logs.report.numbers import estimate, number, percent
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import SIGNALS

#: Units that end a name of the evidence, the longest first.
_UNITS: Final = (
    ("_rad_s2", "rad/s²"),
    ("_deg_s", "deg/s"),
    ("_rad_s", "rad/s"),
    ("_kg_m2", "kg m²"),
    ("_n_m", "N m"),
    ("_deg", "deg"),
    ("_db", "dB"),
    ("_hz", "Hz"),
    ("_ms", "ms"),
    ("_s", "s"),
)
_PHRASES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "above_noise": "windows above the noise",
        "airborne": "time in the air",
        "better": "better",
        "block": "length of a validation segment",
        "chi_square": "chi-square of the differences",
        "ci95": "95 % interval",
        "ci95_half_width": "half of the 95 % interval",
        "effectiveness_over_that_of_all": "effectiveness of each flight over that of all",
        "commanded_r2": "fraction predicted of what was commanded (R²)",
        "corrupt_bytes": "unreadable bytes",
        "cutoff": "cut-off of the filter",
        "departure": "departure from one effectiveness, lag and damping",
        "file_bytes": "bytes in the file",
        "found": "signals found",
        "gain": "effectiveness B",
        "gain_db": "gain margin [dB]",
        "gap_free": "flight without gaps",
        "gaps": "number of gaps",
        "fraction_accepted": "accepted",
        "fraction_at_limits": "part of the flight with motors at their limits",
        "fraction_of_range": "of the command's range",
        "held_out_r2": "fraction predicted on validation data (R²)",
        "known_to": "measured up to",
        "mean_rate": "mean rate with all gaps",
        "needed": "needed at least",
        "p_value": "probability by chance",
        "power_over_surroundings": "power relative to the neighbouring frequencies",
        "probability_of_none": "probability by chance",
        "needed_r2": "fraction needed (R²)",
        "rate": "logged at",
        "rate_rms": "motion (rate RMS)",
        "sd_between_flights": "standard deviation between flights",
        "signal_to_noise": "signal to noise (power)",
        "simulated_rate_r2": "fraction of the simulated motion (R²)",
        "torque_rms": "torque RMS",
    }
)


def evidence_name(key: str) -> str:
    """Return the name of an entry of the evidence in words, its unit in brackets.

    Examples
    --------
    >>> evidence_name("needed_hz"), evidence_name("longest_gap_s"), evidence_name("body_rate")
    ('needed at least [Hz]', 'longest gap [s]', 'body rate')
    """
    if key in _PHRASES:
        return _PHRASES[key]
    ending, unit = next(((end, unit) for end, unit in _UNITS if key.endswith(end)), ("", ""))
    stem = key.removesuffix(ending)
    words = _PHRASES.get(stem) or printable(stem, 60).replace("_", " ")
    return f"{words} [{unit}]" if unit else words


def evidence_phrase(key: str, value: object) -> str:
    """Return an entry of the evidence as people say it: its name, its value, then the unit.

    Examples
    --------
    >>> evidence_phrase("known_to_hz", 5.0), evidence_phrase("cutoff_hz", [20.0, 40.0])
    ('measured up to 5 Hz', 'cut-off of the filter 20, 40 Hz')
    """
    words, text = evidence_name(key), evidence_text(key, value)
    name, _, unit = words.removesuffix("]").partition(" [")
    return f"{words} {text}" if isinstance(value, Mapping) or not unit else f"{name} {text} {unit}"


def evidence_text(key: str, value: object) -> str:
    """Return a value of the evidence as text: a fraction in per cent, anything else as it is.

    Examples
    --------
    >>> evidence_text("fraction_of_flight", {"roll": 0.0013}), evidence_text("gaps", 3)
    ('roll: 0.13 %', '3')
    >>> evidence_text("probability_of_none", 0.0)
    'below 1e-15'
    """
    if key.startswith("probability_") and value == 0.0:
        return "below 1e-15"  # less than a float tells from none
    if key == "target_factors" and isinstance(value, Mapping):
        # By parameter, as its autopilot spells it.
        return ", ".join(
            f"{printable(str(name), 60)}: {evidence_value(item)}" for name, item in value.items()
        )
    if not key.startswith("fraction_"):
        return evidence_value(value)
    if isinstance(value, Mapping):
        return ", ".join(
            f"{evidence_name(str(name))}: {evidence_text(key, item)}" for name, item in value.items()
        )
    return percent(float(value)) if isinstance(value, float) else evidence_value(value)


def evidence_value(value: object) -> str:
    """Return a value of the evidence as text.

    Examples
    --------
    >>> evidence_value({"out_of_order": 3, "source": "gyro"}), evidence_value([1.5, True])
    ('out of order: 3, source: gyro', '1.5, yes')
    >>> evidence_value({"value": 2.05, "ci95": [1.5, 2.69]})
    '2.05 (1.50 to 2.69)'
    """
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return number(float(value))
    if isinstance(value, Mapping) and value.keys() == {"value", "ci95"}:
        return estimate(float(value["value"]), *map(float, value["ci95"]))
    if isinstance(value, Mapping):
        items = list(value.items())[:12]
        return ", ".join(f"{evidence_name(str(key))}: {evidence_value(item)}" for key, item in items)
    if isinstance(value, Iterable) and not isinstance(value, str):
        return ", ".join(evidence_value(item) for item in list(value)[:12]) or "nothing"
    text = printable(value)
    return signal_name(text) if text in SIGNALS else text


def signal_name(signal: str) -> str:
    """Return the canonical name of a signal in words.

    Examples
    --------
    >>> signal_name("torque_n_m"), signal_name("body_rate_setpoint")
    ('torque', 'body rate setpoint')
    """
    return printable(signal.removesuffix("_n_m"), 60).replace("_", " ")


def pretty_unit(unit: str) -> str:
    """Return a unit with raised exponents.

    Examples
    --------
    >>> pretty_unit("rad/s^2")
    'rad/s²'
    """
    return printable(unit, 60).replace("^2", "²").replace("^-1", "⁻¹")
