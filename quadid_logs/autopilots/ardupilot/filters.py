"""ArduPilot's gyro filters from its parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

from quadid_logs.autopilots.filters import gyro_filter
from quadid_logs.data.log import GyroFilter, Notch, whole_number

#: INS_HNTCH_MODE of notches whose frequency is known: fixed, and throttle, which holds FREQ at hover.
_KNOWN_MODES: Final = (0.0, 1.0)
#: INS_HNTCH_OPTS: so many notches side by side, each of its part of the width.
_SIDE_BY_SIDE: Final = {1: 2, 16: 3}
_MOST_HARMONICS: Final = 16
#: Sets of parameters of notches.
_SETS: Final = ("INS_HNTCH", "INS_HNTC2", "INS_NOTCH")


def parameter_filter(parameters: Mapping[str, float]) -> GyroFilter:
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
    return gyro_filter(parameters.get("INS_GYRO_FILTER", math.nan), _notches(parameters))


def follows_unknown(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the modes of notches that follow rotor speed or a spectrum, by parameter."""
    unknown = (name for name in _SETS if _is_on(parameters, name) and not _is_known(parameters, name))
    return {f"{name}_MODE": parameters[f"{name}_MODE"] for name in unknown}


def _notches(parameters: Mapping[str, float]) -> Iterator[Notch]:
    for name in _SETS:
        if _is_on(parameters, name) and _is_known(parameters, name):
            yield from _harmonics(parameters, name)


def _is_on(parameters: Mapping[str, float], name: str) -> bool:
    return parameters.get(f"{name}_ENABLE") == 1.0


def _is_known(parameters: Mapping[str, float], name: str) -> bool:
    """Tell whether the parameters say where the notches stand."""
    return parameters.get(f"{name}_MODE", 0.0) in _KNOWN_MODES or parameters.get(f"{name}_REF", 0.0) == 0.0


def _harmonics(parameters: Mapping[str, float], name: str) -> Iterator[Notch]:
    """Yield the notches of one set of parameters: one or more at each harmonic of its bit mask."""
    frequency_hz, width_hz, depth_db = (
        parameters.get(f"{name}_{suffix}", math.nan) for suffix in ("FREQ", "BW", "ATT")
    )
    options = whole_number(parameters.get(f"{name}_OPTS"))
    count = next((n for bit, n in _SIDE_BY_SIDE.items() if options & bit), 1)
    harmonics = whole_number(parameters.get(f"{name}_HMNCS", 1.0))
    lower_edge_hz = frequency_hz - 0.5 * width_hz / count
    if not (0.0 < lower_edge_hz < frequency_hz and 0.0 < depth_db < 200.0):
        return
    ratio = frequency_hz / lower_edge_hz
    for harmonic in range(_MOST_HARMONICS):
        if harmonics >> harmonic & 1:
            centre_hz = frequency_hz * (harmonic + 1)
            yield from [Notch(centre_hz, ratio - 1.0 / ratio, 10.0 ** (-depth_db / 20.0))] * count
