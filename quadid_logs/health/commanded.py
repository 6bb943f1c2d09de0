"""The thrust that each rotor was sent, whatever the log holds of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align import Prepared
from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import AnyArray, FloatArray

#: Of outputs of which nothing says how thrust follows from them: (1 - e) x + e x^2, with the e that
#: fits most propellers (docs/torque.md).
_EXPO: Final = 0.65
_FEWEST_ROTORS: Final = 3
#: The same but for the rounding of a log.
_AS_SENT: Final = 1e-3


class Commanded(NamedTuple):
    """What the rotors were sent.

    Attributes
    ----------
    series : CleanSeries
        A column for each rotor, in any unit that is the same for all.
    place : ndarray, shape (n_rotors, 3)
        Forward and to the right as fractions of the longest arm, and the spin (+1 counter-clockwise).
    """

    series: CleanSeries
    place: FloatArray


def commanded_thrust(prepared: Prepared) -> Commanded | None:
    """Return what each rotor was sent as a thrust, not what measured speeds say that it gave.

    None where frame or outputs are not known.
    """
    model = prepared.log.torque
    if model is None or model.n_rotors < _FEWEST_ROTORS or len(model.position) != model.n_rotors:
        return None
    reach = float(np.hypot(*model.position[:, :2].T).max())
    if not (np.isfinite(model.position[:, :2]).all() and reach > 0.0 and np.abs(model.spin).all()):
        return None
    place = np.column_stack([model.position[:, :2] / reach, model.spin])
    series = _as_thrust(prepared, model.n_rotors)
    return None if series is None or series.n_samples < 2 else Commanded(series, place)


def _as_thrust(prepared: Prepared, n_rotors: int) -> CleanSeries | None:
    """Return the thrusts by the best source."""
    torque, motors = prepared.torque, prepared.series.get("motor_thrust")
    rebuilt = None if torque is None else torque.rotor_thrust
    if motors is not None and motors.n_columns >= n_rotors:
        sent = motors.values[:, :n_rotors]
        # What measured speeds have corrected of each motor hides a weak one.
        return replace(motors, stored=sent if _is_scaled(rebuilt, sent) else _curve(sent))
    if torque is not None and rebuilt is not None and rebuilt.shape[1] == n_rotors:
        speeds = prepared.series.get("rotor_speed")
        if speeds is None or not _is_scaled(rebuilt, speeds.values**2):
            return replace(torque.series, stored=rebuilt)
    pulses, model = prepared.series.get("output_pwm"), prepared.log.torque
    if pulses is None or model is None or model.output_range_us is None:
        return None
    if len(model.channels) != n_rotors or max(model.channels) > pulses.n_columns:
        return None
    low, high = model.output_range_us
    values = (pulses.values[:, [channel - 1 for channel in model.channels]] - low) / (high - low)
    return replace(pulses, stored=_curve(values))


def _curve(output: FloatArray) -> FloatArray:
    level = np.clip(output, 0.0, 1.0)
    return np.asarray((1.0 - _EXPO) * level + _EXPO * level**2, dtype=np.float64)


def _is_scaled(thrust: AnyArray | None, values: FloatArray) -> bool:
    """Return whether thrusts are these values times one factor."""
    if thrust is None or thrust.shape != values.shape:
        return False
    good = (values > 0.25 * float(np.nanmax(values, initial=0.0))).all(axis=1)
    if not good.any():
        return False
    ratio = np.asarray(thrust, dtype=np.float64)[good] / values[good]
    return bool(np.nanstd(ratio) < _AS_SENT * abs(float(np.nanmean(ratio))))
