"""PX4's gyro filters from its parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from quadid_logs.autopilots.filters import gyro_filter
from quadid_logs.data.log import GyroFilter, Notch


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
    return gyro_filter(parameters.get("IMU_GYRO_CUTOFF", math.nan), _notches(parameters))


def _notches(parameters: Mapping[str, float]) -> Iterator[Notch]:
    for frequency, width in (
        ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW"),
        ("IMU_GYRO_NF1_FRQ", "IMU_GYRO_NF1_BW"),
        ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW"),
    ):
        frequency_hz, width_hz = parameters.get(frequency, 0.0), parameters.get(width, math.nan)
        if 0.0 < width_hz < 2.0 * frequency_hz:
            yield Notch(float(frequency_hz), float(width_hz / frequency_hz), 0.0)
