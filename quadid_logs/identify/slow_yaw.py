"""Yaw from a log that is too slow for roll and pitch.

Rotors and rate loops answer in roll and pitch within a sample of a 10 Hz log. In yaw, where the drag of
the rotors is the torque, a rate loop takes several: its motion below 2.5 Hz is in the log, and set-points
tell what of it was commanded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model, Response
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.equation_by_equation import checked
from quadid_logs.identify.excitation import ColumnNoise, noise_density
from quadid_logs.identify.first_stage import with_strong_instruments
from quadid_logs.identify.model import actuated_model
from quadid_logs.identify.parameters import MAX_RELATIVE_CI
from quadid_logs.identify.response import responses, slope_and_phase
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.yaw import fit_with_reaction
from quadid_logs.vocabulary import AXES, ON_AXIS

#: The slowest log that holds two octaves above the default lower edge at four samples a cycle.
MIN_YAW_RATE_HZ: Final = 8.0
#: Where a yaw loop stops answering; above, feedback and what lies between the samples rule.
_CUTOFF_HZ = 2.5
_SAMPLES_PER_CYCLE = 4.0
#: Of simulated flights logged at 10 to 25 Hz the effectiveness is off by up to this fraction for the torque
#: between the samples, whatever the residuals say.
_BETWEEN_SAMPLES = 0.05
_ROWS_PER_UNKNOWN = 10
#: Three third octaves, an octave, known to a quarter have a slope: 0 that of a vehicle, below 1 with a lead.
_KNOWN = 0.25
_FEWEST_BANDS = 3
_LEAST_SLOPE = 0.5
_OFF_INVERSE_DEG = 60.0
_REASON = "the log is too slow for it"
_WIDE = "its 95 % interval is wide"
_YAW = 2


def may_tell_yaw(data: FlightData) -> bool:
    """Say whether yaw may be told by a log, whatever its rate is: fast enough for that, with set-points.

    Parameters
    ----------
    data : FlightData

    Returns
    -------
    bool
    """
    if data.input is None or any(segment.reference is None for segment in data.segments):
        return False
    needed = [data.sources[name] for name in (data.input.kind, "body_rate") if name in data.sources]
    return bool(data.segments) and min(source.rate_hz for source in needed) >= MIN_YAW_RATE_HZ


def fit_slow_yaw(
    data: FlightData, structure: Structure, settings: IdentifySettings, rate_hz: float
) -> tuple[Model, Design] | None:
    """Fit yaw to a slow log with set-points.

    Parameters
    ----------
    data : FlightData
    structure : Structure
        To be fitted equation by equation.
    settings : IdentifySettings
    rate_hz : float
        Of the slower of torque and rates.

    Returns
    -------
    Model
        In which nothing but the on-axis effectiveness of yaw is identified. None in the place of both
        where the log is too slow, too short, or its set-points do not tell the torque.
    Design
        Its high-passed rows.
    """
    if rate_hz < MIN_YAW_RATE_HZ:
        return None
    cutoff_hz = settings.smoothing_hz or min(_CUTOFF_HZ, rate_hz / _SAMPLES_PER_CYCLE)
    design = build_design(data, cutoff_hz, [structure])
    if design is None or np.count_nonzero(design.train) < _ROWS_PER_UNKNOWN * len(structure.columns):
        return None
    design = with_strong_instruments(design, design.high_passed(settings.high_pass_hz), [_YAW])
    if design.instruments is None:
        return None
    found = fit_with_reaction(data, design, structure.known(design.torque.symbols), settings, voting=(_YAW,))
    noise = ColumnNoise(noise_density(data), design.columns, cutoff_hz)
    model = actuated_model(data, checked(found.fit), settings, noise)
    # The effectiveness of yaw with a wider interval; anything else is not identified.
    own = model.entries[ON_AXIS[AXES[_YAW]]]
    half = _BETWEEN_SAMPLES * abs(own.value)
    low, high = (abs(bound - own.value) for bound in own.ci95)
    wider = (own.value - float(np.hypot(low, half)), own.value + float(np.hypot(high, half)))
    wide = 0.5 * (wider[1] - wider[0]) > MAX_RELATIVE_CI * abs(own.value)
    parameters = tuple(
        replace(each, ci95=wider, identifiable=not wide, reason=_WIDE if wide else "")
        if each is own
        else replace(each, identifiable=False, reason=_REASON)
        for each in model.parameters
    )
    model = replace(found.on(model), recommended=True, parameters=parameters, inertia=None)
    follows = _follows_motion(responses(data, by_setpoints=())[_YAW:], cutoff_hz)
    model = replace(model, yaw_is_inverse_controller=model.yaw_is_inverse_controller or follows)
    return model, found.fit.model.design


def _follows_motion(found: Sequence[Response], cutoff_hz: float) -> bool:
    """Say whether a response, of yaw, is that of the inverse controller.

    A response that grows with the n-th power of frequency leads by n right angles (H. W. Bode, 1945), and
    what lags makes it lead less; -1/C, of the other sign, is two right angles from that.
    `quadid_logs.identify.response.feedback_in` wants four third octaves in a row, each by itself. A slow log
    has three here, about one line through them: two of five flown hovers would pass there.
    """
    for each in found:
        known = np.flatnonzero((each.error < _KNOWN) & (each.frequency_hz < cutoff_hz))
        if known.size >= _FEWEST_BANDS:
            slope, phase_deg = slope_and_phase(each, known)
            off_deg = (phase_deg - 90.0 * slope) % 360.0 - 180.0
            return slope >= _LEAST_SLOPE and abs(off_deg) <= _OFF_INVERSE_DEG
    return False
