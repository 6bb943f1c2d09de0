"""ArduPilot's gyro filters from its parameters, and from what its notches followed in flight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.followed import CENTRES, PEAK, PEAKS, ROTORS, RPM_SENSORS, THROTTLE
from quadid_logs.autopilots.discrete import gyro_filter
from quadid_logs.data.log import GyroFilter, Notch, Places, whole_number

#: INS_HNTCH_MODE.
_FIXED, _THROTTLE, _RPM, _ESC, _FFT, _RPM2 = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
#: INS_HNTCH_OPTS: so many notches side by side, each of its part of the width.
_SIDE_BY_SIDE: Final = {1: 2, 16: 3, 64: 5}
#: Places of the notches side by side, in steps of an eighth of a quarter of the width.
_STEPS: Final = {1: (0.0,), 2: (-1.0, 1.0), 3: (0.0, -1.0, 1.0), 5: (0.0, -1.0, 1.0, -2.0, 2.0)}
#: INS_HNTCH_OPTS: a notch for each motor or peak; what is low counts as the lowest.
_MULTI_SOURCE: Final = 2
_LOW_AS_LOWEST: Final = 32
_MOST_HARMONICS: Final = 16
#: Sets of parameters of notches, the first two with a number in the log.
_SETS: Final = ("INS_HNTCH", "INS_HNTC2", "INS_NOTCH")
#: Since then a notch below its lowest frequency fades, and is gone at a part of that; before, it stood there
#: and its harmonics with it (the clamping was reworked in January 2024).
_FADES_SINCE: Final = (4, 5)
_GONE_BELOW: Final = 0.25
#: Of the gyro's rate; a notch above is switched off.
_HIGHEST: Final = 0.48
_KILOHERTZ: Final = 1000.0
#: AP_InertialSensor: INS_GYRO_RATE n means 2^n kHz, up to 8 kHz.
_FASTEST: Final = 3
_NOTHING: Final[Mapping[str, FloatArray]] = MappingProxyType({})


def gyro_period_s(parameters: Mapping[str, float]) -> float:
    """Return the period of the gyro's samples that are filtered, by INS_GYRO_RATE [s]."""
    doublings = min(max(whole_number(parameters.get("INS_GYRO_RATE")), 0), _FASTEST)
    return 1.0 / (_KILOHERTZ * 2.0**doublings)


def parameter_filter(
    parameters: Mapping[str, float],
    followed: Mapping[str, FloatArray] = _NOTHING,
    version: tuple[int, ...] | None = None,
) -> GyroFilter:
    """Return INS_GYRO_FILTER and the notches of INS_HNTCH_*, INS_HNTC2_*, earlier INS_NOTCH_*.

    Parameters
    ----------
    followed : mapping of str to ndarray, shape (n_instants, n_columns)
        Of the log: see `followed.followed`.
    version : tuple of int or None
        Of the firmware; None counts as the newest.

    Returns
    -------
    GyroFilter
        With the fixed notches, and those that follow what the log holds. Notches on the throttle of a log
        without one are as at their reference, hover. Where a log does not hold what they follow, their
        delay stays part of the delay that is found.

    Notes
    -----
    The low-pass is a LowPassFilter2p; Q by NotchFilter::calculate_A_and_Q, harmonics, widths and places by
    HarmonicNotchFilter.cpp, centres by AP_Vehicle::update_dynamic_notch.
    """
    sets = notch_sets(parameters, followed, version)
    return gyro_filter(
        parameters.get("INS_GYRO_FILTER", math.nan),
        [notch for places in sets.values() if len(places) == 1 for notch in places[0]],
        [places for places in sets.values() if len(places) > 1],
    )


def notch_sets(
    parameters: Mapping[str, float],
    followed: Mapping[str, FloatArray] = _NOTHING,
    version: tuple[int, ...] | None = None,
) -> dict[str, Places]:
    """Return where the notches of each set stood, by the set's name; see `parameter_filter`.

    One instant for what did not move; a set of which it is not known is not in it.
    """
    fades = version is None or version >= _FADES_SINCE
    found = {name: _Set.of(parameters, name, fades=fades) for name in _SETS if _is_on(parameters, name)}
    placed = {name: each.places(followed) for name, each in found.items() if each is not None}
    return {name: places for name, places in placed.items() if places is not None}


def follows_unknown(
    parameters: Mapping[str, float], followed: Mapping[str, FloatArray] = _NOTHING
) -> dict[str, float]:
    """Return the modes of notches that follow what the log does not hold, by parameter."""
    known = notch_sets(parameters, followed)
    unknown = (name for name in _SETS if _is_on(parameters, name) and name not in known)
    modes = {f"{name}_MODE": parameters.get(f"{name}_MODE", _FIXED) for name in unknown}
    return {name: mode for name, mode in modes.items() if mode not in (_FIXED, _THROTTLE)}


def _is_on(parameters: Mapping[str, float], name: str) -> bool:
    return parameters.get(f"{name}_ENABLE") == 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Set:
    """One set of parameters of notches."""

    number: int
    frequency_hz: float
    width_hz: float
    depth_db: float
    reference: float
    lowest_hz: float
    mode: float
    options: int
    harmonics: tuple[int, ...]
    highest_hz: float
    fades: bool

    @classmethod
    def of(cls, parameters: Mapping[str, float], name: str, *, fades: bool) -> _Set | None:
        """Return the set of this name, None where its numbers make no notch."""
        frequency_hz, width_hz, depth_db = (
            parameters.get(f"{name}_{suffix}", math.nan) for suffix in ("FREQ", "BW", "ATT")
        )
        mask = whole_number(parameters.get(f"{name}_HMNCS", 1.0))
        mode = parameters.get(f"{name}_MODE", _FIXED)
        ratio = parameters.get(f"{name}_FM_RAT", 1.0)
        lowers = (fades or mode == _THROTTLE) and 0.0 < ratio <= 1.0
        found = cls(
            number=_SETS.index(name),
            frequency_hz=frequency_hz,
            width_hz=width_hz,
            depth_db=depth_db,
            reference=parameters.get(f"{name}_REF", 0.0),
            lowest_hz=frequency_hz * (ratio if lowers else 1.0),
            mode=mode,
            options=whole_number(parameters.get(f"{name}_OPTS")),
            harmonics=tuple(place + 1 for place in range(_MOST_HARMONICS) if mask >> place & 1),
            highest_hz=_HIGHEST / gyro_period_s(parameters),
            fades=fades,
        )
        edge_hz = frequency_hz - 0.5 * width_hz / found.n_abreast
        return found if 0.0 < edge_hz < frequency_hz < math.inf and 0.0 < depth_db < 200.0 else None

    @property
    def n_abreast(self) -> int:
        """Notches side by side."""
        return next((n for bit, n in _SIDE_BY_SIDE.items() if self.options & bit), 1)

    def places(self, followed: Mapping[str, FloatArray]) -> Places | None:
        """Return where the notches stood at instants of the flight, None where it is not known."""
        centres_hz = self._centres_hz(followed)
        return None if centres_hz is None else tuple(tuple(self._notches(row)) for row in centres_hz.tolist())

    def _centres_hz(self, followed: Mapping[str, FloatArray]) -> FloatArray | None:
        """Return what the fundamentals follow, shape (n_instants, n_sources)."""
        fixed = np.full((1, 1), self.frequency_hz)
        if self.mode == _FIXED or not self.reference > 0.0:
            return fixed
        if self.number < len(CENTRES) and self.harmonics and CENTRES[self.number] in followed:
            first = self.harmonics[0] * (1.0 + _STEPS[self.n_abreast][0] * self._step)
            return followed[CENTRES[self.number]] / first
        if self.mode == _THROTTLE:
            if THROTTLE not in followed:
                return fixed
            share = np.maximum(followed[THROTTLE], 0.0) / self.reference
            return np.asarray(self.frequency_hz * np.sqrt(share))
        if self.mode in (_RPM, _RPM2):
            speed_hz = followed.get(RPM_SENSORS[int(self.mode == _RPM2)])
            return None if speed_hz is None else speed_hz * self.reference
        several = bool(self.options & _MULTI_SOURCE)
        if self.mode == _ESC:
            rotors_hz = followed.get(ROTORS)
            if rotors_hz is None or several:
                return rotors_hz
            return np.asarray(rotors_hz.mean(axis=1, keepdims=True) * self.reference)
        return followed.get(PEAKS if several else PEAK) if self.mode == _FFT else None

    @property
    def _step(self) -> float:
        """By what part of a centre notches side by side are apart."""
        return self.width_hz / (32.0 * self.frequency_hz)

    def _notches(self, centres_hz: list[float]) -> Iterator[Notch]:
        """Yield the notches that stand at fundamentals of these frequencies, and at their harmonics."""
        edge_hz = self.frequency_hz - 0.5 * self.width_hz / self.n_abreast
        ratio = self.frequency_hz / edge_hz
        for harmonic in self.harmonics:
            for centre_hz in centres_hz:
                placed_hz, share = self._placed(centre_hz, harmonic)
                # The root of the depth fades to one: NotchFilter's A, whose square is the gain at the centre.
                root = 10.0 ** (-self.depth_db / 40.0)
                depth = (1.0 + share * (root - 1.0)) ** 2
                if share > 0.0 and placed_hz < self.highest_hz:
                    for step in _STEPS[self.n_abreast]:
                        yield Notch(placed_hz * (1.0 + step * self._step), ratio - 1.0 / ratio, depth)

    def _placed(self, centre_hz: float, harmonic: int) -> tuple[float, float]:
        """Return where a notch stands that wants to be there, and how much of it there is."""
        if not self.fades:
            return max(centre_hz, self.lowest_hz) * harmonic, 1.0
        wanted_hz, lowest_hz = centre_hz * harmonic, self.lowest_hz
        if self.options & _LOW_AS_LOWEST:
            return max(wanted_hz, lowest_hz * harmonic), 1.0
        share = (wanted_hz / lowest_hz - _GONE_BELOW) / (1.0 - _GONE_BELOW)
        return max(wanted_hz, lowest_hz), min(max(share, 0.0), 1.0)
