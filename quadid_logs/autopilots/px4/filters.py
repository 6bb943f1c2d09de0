"""PX4's gyro filters from its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.discrete import butterworth, first_order
from quadid_logs.autopilots.filters import gyro_filter
from quadid_logs.data.controller import DiscreteFilter
from quadid_logs.data.log import GyroFilter, Notch

_DEFAULT_CUTOFF_HZ: Final = 20.0


def parameter_filter(parameters: Mapping[str, float]) -> GyroFilter:
    """Return IMU_GYRO_CUTOFF (LowPassFilter2p) and the notches of IMU_GYRO_NF0_*, NF1_*, earlier NF_*.

    Parameters
    ----------
    parameters : mapping of str to float

    Returns
    -------
    GyroFilter

    Notes
    -----
    PX4: VehicleAngularVelocity.cpp, NotchFilter.hpp.
    """
    return gyro_filter(parameters.get("IMU_GYRO_CUTOFF", math.nan), notches_by_name(parameters).values())


def derivative_filter(parameters: Mapping[str, float], period_s: float) -> DiscreteFilter:
    """Return the filter at IMU_DGYRO_CUTOFF on the slope of the rates, which D acts on.

    Parameters
    ----------
    parameters : mapping of str to float
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
