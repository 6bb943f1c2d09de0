"""The filters that the autopilot's parameters put between the gyro and what it logs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from quadid_logs.data.log import GyroFilter, Notch, Signal, whole_number

#: A notch below is no vibration's, and one above moves nothing that is fitted.
_RANGE_HZ = (5.0, 2000.0)
#: One narrower than this share of its frequency delays what is slower by less than a microsecond.
_LEAST_INVERSE_Q = 1e-6
#: INS_HNTCH_MODE of notches whose frequency is known: fixed, and throttle, which holds FREQ at hover.
_KNOWN_MODES = (0.0, 1.0)
#: INS_HNTCH_OPTS: so many notches side by side, each of its share of the width.
_SIDE_BY_SIDE = {1: 2, 16: 3}
_MOST_HARMONICS = 16


def ardupilot_gyro_filter(parameters: Mapping[str, float]) -> GyroFilter:
    """Return INS_GYRO_FILTER and the notches of INS_HNTCH_*, INS_HNTC2_*, earlier INS_NOTCH_*.

    Parameters
    ----------
    parameters : mapping of str to float

    Returns
    -------
    GyroFilter
        With the fixed notches, and those that follow the throttle as they are in
        hover. Where they follow rotor speed or a spectrum, the parameters do
        not tell, and their delay stays part of the delay that is found.

    Notes
    -----
    The low-pass is a LowPassFilter2p; Q by NotchFilter::calculate_A_and_Q,
    harmonics and widths by HarmonicNotchFilter.cpp.
    """
    return _gyro_filter(parameters.get("INS_GYRO_FILTER", math.nan), _ardupilot_notches(parameters))


def _ardupilot_notches(parameters: Mapping[str, float]) -> Iterator[Notch]:
    for name in ("INS_HNTCH", "INS_HNTC2", "INS_NOTCH"):
        if parameters.get(f"{name}_ENABLE") != 1.0:
            continue
        mode, reference = parameters.get(f"{name}_MODE", 0.0), parameters.get(f"{name}_REF", 0.0)
        if mode not in _KNOWN_MODES and reference != 0.0:
            continue
        frequency_hz, width_hz, depth_db = (
            parameters.get(f"{name}_{suffix}", math.nan) for suffix in ("FREQ", "BW", "ATT")
        )
        options = whole_number(parameters.get(f"{name}_OPTS"))
        count = next((n for bit, n in _SIDE_BY_SIDE.items() if options & bit), 1)
        harmonics = whole_number(parameters.get(f"{name}_HMNCS", 1.0))
        lower_edge_hz = frequency_hz - 0.5 * width_hz / count
        if not (0.0 < lower_edge_hz < frequency_hz and 0.0 < depth_db < 200.0):
            continue
        ratio = frequency_hz / lower_edge_hz
        for harmonic in range(_MOST_HARMONICS):
            if harmonics >> harmonic & 1:
                centre_hz = frequency_hz * (harmonic + 1)
                yield from [Notch(centre_hz, ratio - 1.0 / ratio, 10.0 ** (-depth_db / 20.0))] * count


def px4_gyro_filter(parameters: Mapping[str, float]) -> GyroFilter:
    """Return IMU_GYRO_CUTOFF (LowPassFilter2p) and the notches of IMU_GYRO_NF0_*, NF1_*, earlier NF_*.

    PX4: VehicleAngularVelocity.cpp, NotchFilter.hpp.
    """
    return _gyro_filter(parameters.get("IMU_GYRO_CUTOFF", math.nan), _px4_notches(parameters))


def _px4_notches(parameters: Mapping[str, float]) -> Iterator[Notch]:
    for frequency, width in (
        ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW"),
        ("IMU_GYRO_NF1_FRQ", "IMU_GYRO_NF1_BW"),
        ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW"),
    ):
        frequency_hz, width_hz = parameters.get(frequency, 0.0), parameters.get(width, math.nan)
        if 0.0 < width_hz < 2.0 * frequency_hz:
            yield Notch(float(frequency_hz), float(width_hz / frequency_hz), 0.0)


def _gyro_filter(low_pass_hz: float, notches: Iterable[Notch]) -> GyroFilter:
    """Return the filters that change anything."""
    felt = tuple(
        notch
        for notch in notches
        if _RANGE_HZ[0] <= notch.frequency_hz <= _RANGE_HZ[1]
        and _LEAST_INVERSE_Q <= notch.inverse_q < math.inf
        and notch.depth < 1.0
    )
    return GyroFilter(float(low_pass_hz) if 0.0 < low_pass_hz < math.inf else math.nan, felt)


def with_gyro_filter(
    signals: dict[str, tuple[Signal, ...]], known: GyroFilter, messages: tuple[str, ...]
) -> dict[str, tuple[Signal, ...]]:
    """Note the filter at the body rates from messages whose names begin so."""
    if "body_rate" not in signals:
        return signals
    rates = tuple(
        replace(signal, gyro_filter=known) if signal.source.startswith(messages) else signal
        for signal in signals["body_rate"]
    )
    return {**signals, "body_rate": rates}
