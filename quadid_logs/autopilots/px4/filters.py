"""PX4's gyro filters from its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.discrete import butterworth, first_order, gyro_filter
from quadid_logs.data.controller import DiscreteFilter
from quadid_logs.data.log import GyroFilter, Notch, Places, whole_number

_DEFAULT_CUTOFF_HZ: Final = 20.0
#: Of what a log holds for notches to follow: the speeds of the rotors [Hz].
ROTORS: Final = "rotors_hz"
#: IMU_GYRO_DNF_EN: bit 0 follows the rotors' speeds, bit 1 peaks of a spectrum, of each axis its own.
_ROTORS: Final = 1
#: Width and lowest frequency [Hz] of notches that follow the rotors, unless set.
_DYNAMIC_DEFAULTS: Final = MappingProxyType({"BW": 15.0, "MIN": 25.0})
_MOST_HARMONICS: Final = 10
_NOTHING: Final[Mapping[str, FloatArray]] = MappingProxyType({})


def parameter_filter(
    parameters: Mapping[str, float], followed: Mapping[str, FloatArray] = _NOTHING
) -> GyroFilter:
    """Return IMU_GYRO_CUTOFF (LowPassFilter2p) and the notches of IMU_GYRO_NF0_*, NF1_*, earlier NF_*.

    Parameters
    ----------
    followed : mapping of str to ndarray, shape (n_instants, n_rotors)
        Of the log, the speeds of the rotors [Hz] that the notches of IMU_GYRO_DNF_* follow.

    Notes
    -----
    PX4: VehicleAngularVelocity.cpp, NotchFilter.hpp.
    """
    return gyro_filter(
        parameters.get("IMU_GYRO_CUTOFF", math.nan),
        notches_by_name(parameters).values(),
        rotor_notches(parameters, followed),
    )


def follows_unknown(parameters: Mapping[str, float], followed: Mapping[str, FloatArray]) -> bool:
    """Tell whether notches follow what the log does not hold: a spectrum, or speeds that are not there."""
    enabled = whole_number(parameters.get("IMU_GYRO_DNF_EN"))
    missing = bool(enabled & _ROTORS) and not rotor_notches(parameters, followed)
    return missing or bool(enabled & ~_ROTORS)


def rotor_notches(parameters: Mapping[str, float], followed: Mapping[str, FloatArray]) -> tuple[Places, ...]:
    """Return the notches that follow each rotor's speed, none where they are off or nothing tells it.

    Notes
    -----
    `UpdateDynamicNotchEscRpm`: as speeds fall, a harmonic stays at the lowest frequency plus half a width for
    each harmonic before it. All have the same width in hertz.
    """
    speeds_hz = followed.get(ROTORS)
    width_hz, lowest_hz = (
        parameters.get(f"IMU_GYRO_DNF_{short}", value) for short, value in _DYNAMIC_DEFAULTS.items()
    )
    on = whole_number(parameters.get("IMU_GYRO_DNF_EN")) & _ROTORS
    if not on or speeds_hz is None or not (0.0 < width_hz < math.inf and 0.0 <= lowest_hz < math.inf):
        return ()
    harmonics = range(min(max(whole_number(parameters.get("IMU_GYRO_DNF_HMC"), 3), 1), _MOST_HARMONICS))
    parked_hz = [max(lowest_hz, width_hz) + 0.5 * width_hz * place for place in harmonics]
    places = tuple(
        tuple(
            Notch(centre_hz, width_hz / centre_hz, 0.0)
            for place in harmonics
            for speed_hz in row
            for centre_hz in [max(speed_hz * (place + 1), parked_hz[place])]
        )
        for row in speeds_hz.tolist()
    )
    return gyro_filter(math.nan, (), [places]).tracked


def derivative_filter(parameters: Mapping[str, float], period_s: float) -> DiscreteFilter:
    """Return the filter at IMU_DGYRO_CUTOFF on the slope of the rates, which D acts on.

    Parameters
    ----------
    period_s : float
        Of the samples that are filtered [s].

    Returns
    -------
    DiscreteFilter
        Of the second order in firmware that knows one notch only, IMU_GYRO_NF_FREQ; else of the first.

    Notes
    -----
    VehicleAngularVelocity.hpp: LowPassFilter2p, later AlphaFilter. In a loop the order is worth decibels.
    """
    if has_second_order_derivative(parameters) and cutoff_hz(parameters) > 0.0:
        return butterworth(cutoff_hz(parameters), period_s)
    return first_order(cutoff_hz(parameters), period_s)


def cutoff_hz(parameters: Mapping[str, float]) -> float:
    """Return the cut-off of the filter on the angular acceleration [Hz]."""
    return parameters.get("IMU_DGYRO_CUTOFF", _DEFAULT_CUTOFF_HZ)


def has_second_order_derivative(parameters: Mapping[str, float]) -> bool:
    """Tell whether the log is of firmware whose filter on the slope of the rates is of the second order."""
    return "IMU_GYRO_NF_FREQ" in parameters and "IMU_GYRO_NF0_FRQ" not in parameters


def notches_by_name(parameters: Mapping[str, float]) -> dict[str, Notch]:
    """Return the notches by how their parameters' names begin; a width that makes none is left out."""
    found = {}
    for name, frequency in (
        ("IMU_GYRO_NF0", "IMU_GYRO_NF0_FRQ"),
        ("IMU_GYRO_NF1", "IMU_GYRO_NF1_FRQ"),
        ("IMU_GYRO_NF", "IMU_GYRO_NF_FREQ"),
    ):
        frequency_hz, width_hz = parameters.get(frequency, 0.0), parameters.get(f"{name}_BW", math.nan)
        if 0.0 < width_hz < 2.0 * frequency_hz:
            notch = Notch(float(frequency_hz), float(width_hz / frequency_hz), 0.0)
            if gyro_filter(math.nan, [notch]).notches:
                found[name] = notch
    return found
