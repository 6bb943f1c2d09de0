"""Caveats about the recommended model, axis by axis."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.data.catalogue import CALMER, CATALOGUE, WELL_EXCITED_DEG_S, Step
from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import (
    CHANGE_SEEN,
    ChangeCheck,
    Excitation,
    Identification,
    Model,
    Parameter,
    Response,
    SpectralFit,
)
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.identify.design import HELD_OUT_BLOCK_S
from quadid_logs.identify.excitation import MIN_RATE_RMS_DEG_S, holds_one_frequency
from quadid_logs.identify.parameters import (
    MAX_RELATIVE_CI,
    MIN_SIGNAL_TO_NOISE,
    MIN_SIMULATED_R2,
    is_commanded_explained,
    is_explained,
)
from quadid_logs.identify.response import Band, feedback_in, slope_and_phase
from quadid_logs.vocabulary import (
    ACCELERATION_SYMBOLS,
    AXES,
    ON_AXIS,
    RATE_SYMBOLS,
    TABLE_FORMAT,
    explained_words,
)

#: Effectiveness that differs by more than this from band to band is not one number.
_BAND_ERROR = 0.25
_BAND_WARNING = 0.1
#: A battery that empties lowers the effectiveness by some per cent, which the interval covers; more is
#: another vehicle.
_CHANGE_WARNING = 0.1
_CHANGE_ERROR = 0.25
#: Windows of the paper of which a smaller fraction than this rises above the noise.
_FEW_WINDOWS = 0.5
#: Ends of an interval that are farther apart than this factor leave no use for the number. Nearer ones are
#: within a factor of 1.73 (4.8 dB) of their middle, inside the gain margin of 6 dB that every rate loop is to
#: keep: a loop that is tuned for the middle flies while a better flight is made.
_FACTOR_BETWEEN_ENDS = 3.0
#: Of this R2 the torque explains nearly all.
_EXPLAINED = 0.9
_CAUTION_SIGNAL_TO_NOISE = _EXPLAINED / (1.0 - _EXPLAINED)
#: Gusts that leave less of the rate in the fitted band to the torque may take a tenth off its effectiveness.
_CAUTION_SIMULATED_R2 = 0.8
#: Findings that more and quicker commands help against, however much the axis turned.
_COMMANDS_HELP = frozenset({"QL403", "QL516"})
_OTHER: Final[Step] = "other"
_YAW = 2


def find_in_models(log: FlightLog, identification: Identification) -> Iterator[Finding]:
    """Yield the findings about the models.

    Parameters
    ----------
    log : FlightLog
        For what to fly next: autopilot and version.
    identification : Identification

    Yields
    ------
    Finding
    """
    model = identification.recommended
    if model is None:
        return
    for number in [_YAW] if identification.only_yaw else range(len(AXES)):
        yield from _axis(log, identification, model, number)
    moved = (each.rate_rms_rad_s >= np.radians(MIN_RATE_RMS_DEG_S) for each in identification.excitation)
    if not identification.only_yaw and any(moved):
        actuator = model.actuator
        if actuator is not None and actuator.at_bound:
            yield finding(
                "QL507", "warning", {"lag_s": rounded(actuator.lag_s), "delay_s": rounded(actuator.delay_s)}
            )
    yield from _windows(identification)


class _Axis(NamedTuple):
    """What is known about one axis of the recommended model.

    ``asked`` is what its commands tell of it; ``advice`` and ``logging`` say what to fly, and how to log.
    """

    name: str
    number: int
    model: Model
    excitation: Excitation
    on_axis: Parameter
    advice: str
    logging: str
    enough_motion: str
    response: Response | None
    asked: SpectralFit | None
    one_frequency: bool

    @property
    def spectral(self) -> SpectralFit | None:
        """What its commands tell of it, where the model's equation is that."""
        return self.asked if self.asked is not None and self.asked.is_told else None

    @property
    def alone(self) -> bool:
        """Whether commands tell it, or nothing does."""
        return self.asked is not None and self.asked.alone

    @property
    def r2(self) -> float:
        """Fraction of held-out acceleration that the model explains."""
        return self.model.validation.r2_acceleration.get(ACCELERATION_SYMBOLS[self.number], float("nan"))

    @property
    def rate_rms_deg_s(self) -> float:
        """How much the axis turned [deg/s rms]."""
        return float(np.degrees(self.excitation.rate_rms_rad_s))

    def finding(self, code: str, level: Level, evidence: Mapping[str, object], title: str = "") -> Finding:
        """Return a finding about this axis; with what to fly where more motion would help."""
        advice, step = self.advice if CATALOGUE[code].step == "fly" else "", None
        # Where air moves an axis as much, how much it turned says nothing: commands narrow the interval.
        # Where there was one frequency, commands of others do.
        commands_help = code in _COMMANDS_HELP or self.alone or self.one_frequency
        if advice and not commands_help and self.rate_rms_deg_s >= WELL_EXCITED_DEG_S:
            advice, step = self.enough_motion, _OTHER
        return finding(code, level, evidence, axes=(self.name,), advice=advice, title=title, step=step)


_Check = Callable[[_Axis], Finding | None]


def _axis(log: FlightLog, identification: Identification, model: Model, number: int) -> Iterator[Finding]:
    """Judge one axis; the first thing that makes its number worthless is enough."""
    # What to do about an axis that lacks no excitation; in a list of steps it has a name.
    # Who made the columns of a table can look at them.
    columns = " Check units, signs and times of the table's columns." if log.format == TABLE_FORMAT else ""
    axis = _Axis(
        name=AXES[number],
        number=number,
        model=model,
        excitation=identification.excitation[number],
        on_axis=model.entries[ON_AXIS[AXES[number]]],
        advice=advice_for(log.autopilot).excitation(AXES[number : number + 1], log.version),
        logging=advice_for(log.autopilot).logging(log.format, log.parameters, log.version),
        enough_motion=(
            f"This axis turned by more than {WELL_EXCITED_DEG_S:g} deg/s rms, which is enough. Larger "
            f"manoeuvres would not help. {CALMER}{columns}"
        ),
        response=identification.responses[number] if identification.responses else None,
        asked=next(iter(identification.spectral[number : number + 1]), None),
        one_frequency=holds_one_frequency(identification.excitation, number),
    )
    fatal, others = _checks(axis, only_yaw=identification.only_yaw)
    for check in fatal:
        if (found := check(axis)) is not None:
            yield found
            return
    for check in others:
        if (found := check(axis)) is not None:
            yield found


def _checks(axis: _Axis, *, only_yaw: bool) -> tuple[tuple[_Check, ...], tuple[_Check, ...]]:
    """Return the checks of an axis of which the first that speaks is enough, and all others."""
    if only_yaw:
        return _SLOW_FATAL, _SLOW_OTHERS
    if axis.spectral is not None:
        return _SPECTRAL_FATAL, _SPECTRAL_OTHERS
    return (_UNTOLD, ()) if axis.alone else (_FATAL, _OTHERS)


def _evidence(axis: _Axis) -> dict[str, object]:
    return {
        "held_out_r2": rounded(axis.r2),
        "signal_to_noise": rounded(axis.excitation.signal_to_noise),
        "rate_rms_deg_s": rounded(axis.rate_rms_deg_s),
        "torque_rms": rounded(axis.excitation.torque_rms),
    }


def _gain(axis: _Axis) -> dict[str, object]:
    low, high = axis.on_axis.ci95
    return {"gain": rounded(axis.on_axis.value), "ci95": [rounded(low), rounded(high)]}


def _poorly_excited(axis: _Axis) -> Finding | None:
    needed = MIN_RATE_RMS_DEG_S
    if axis.rate_rms_deg_s >= needed:
        return None
    title = (
        f"{axis.name.capitalize()} was poorly excited: it turned by {rounded(axis.rate_rms_deg_s, 2)} deg/s "
        "rms only"
    )
    return axis.finding("QL403", "error", {**_evidence(axis), "needed_deg_s": needed}, title)


def _weakly_commanded(axis: _Axis) -> Finding | None:
    """Refuse an axis whose motion hardly follows from what was commanded, where much of it is the air's."""
    check, asked = axis.model.structural, axis.asked
    # What commands tell alone says itself how strong they are.
    strength = 1.0 if axis.alone or check is None else float(check.strength[axis.number])
    nothing = asked is not None and asked.tells_nothing and (axis.alone or axis.r2 < _EXPLAINED)
    if not strength < 1.0 and not nothing:
        return None
    evidence = {} if check is None else {"f_over_needed": rounded(strength, 2)}
    title = f"The {axis.name} set-points explain too little of the {axis.name} torque"
    return axis.finding("QL403", "error", _evidence(axis) | evidence, title)


def _follows_the_rate(axis: _Axis) -> Finding | None:
    """Refuse an axis of which the log shows the controller: the reason that is behind all others."""
    band, response = axis.model.band, axis.response
    if band is None or response is None:
        return None
    found = feedback_in(response, Band(float(band.low_hz[0]), float(band.cutoff_hz[0])))
    if found is None:
        return None
    slope, phase_deg = slope_and_phase(response, found.run)
    low_hz, high_hz = (rounded(response.frequency_hz[number], 2) for number in found.run[[0, -1]])
    evidence = {
        "from_hz": low_hz,
        "to_hz": high_hz,
        "phase_deg": rounded(phase_deg, 3),
        "grows_with_power_of_frequency": rounded(slope, 2),
        "coherence": rounded(float(response.coherence[found.run].mean()), 2),
        "fraction_of_torque_power_in_band": rounded(found.fraction, 2),
    }
    title = f"From {low_hz:g} to {high_hz:g} Hz the log shows the {axis.name} controller, not the vehicle"
    return axis.finding("QL516", "error", _evidence(axis) | evidence, title)


def _not_explained(axis: _Axis) -> Finding | None:
    explained = axis.excitation.signal_to_noise
    enough = is_explained(axis.model, explained, axis.number)
    if explained >= MIN_SIGNAL_TO_NOISE or (enough and _is_of_use(axis)):
        return None
    return axis.finding("QL504", "error", _evidence(axis), _explained(axis))


def _explained(axis: _Axis) -> str:
    return f"On validation data the model predicts {explained_words(axis.r2)} of the {axis.name} acceleration"


def _wrong_sign(axis: _Axis) -> Finding | None:
    """Refuse a torque that turns the vehicle the other way; an interval that holds both signs is too wide."""
    if axis.on_axis.value > 0.0 or axis.on_axis.ci95[1] >= 0.0:
        return None
    return axis.finding("QL506", "error", _evidence(axis) | _gain(axis))


def _is_of_use(axis: _Axis) -> bool:
    low, high = axis.on_axis.ci95
    return math.isfinite(axis.on_axis.half_width) and high < _FACTOR_BETWEEN_ENDS * low


def _too_wide(axis: _Axis) -> Finding | None:
    """Refuse an effectiveness that may be anything."""
    if _is_of_use(axis) or not (axis.on_axis.half_width > MAX_RELATIVE_CI * axis.on_axis.value):
        return None
    return axis.finding("QL505", "error", _evidence(axis) | _gain(axis))


def _wide(axis: _Axis) -> Finding | None:
    """Warn of an effectiveness that is of use, but not to compare, to calibrate or to tune with."""
    if axis.one_frequency:
        # QL420 says why, and what to fly: calm air would not help.
        return None
    told = axis.spectral is None or axis.spectral.is_sound
    low, high = axis.on_axis.ci95
    # With all that effects leave open: the interval that the user sees.
    if told and not 0.5 * (high - low) > MAX_RELATIVE_CI * axis.on_axis.value:
        return None
    below, above = (100.0 * abs(end / axis.on_axis.value - 1.0) for end in axis.on_axis.ci95)
    title = f"The interval of the {axis.name} effectiveness is wide: -{below:.0f} to +{above:.0f} %"
    return axis.finding("QL505", "warning", _evidence(axis) | _gain(axis), title)


def _partly_explained(axis: _Axis) -> Finding | None:
    if axis.excitation.signal_to_noise >= _CAUTION_SIGNAL_TO_NOISE:
        return None
    rms = axis.rate_rms_deg_s
    weak = f"{axis.name.capitalize()} was weakly excited: it turned by {rounded(rms)} deg/s rms only"
    title = weak if rms < WELL_EXCITED_DEG_S else _explained(axis)
    return axis.finding("QL404", "warning", _evidence(axis), title)


def _not_reproduced(axis: _Axis) -> Finding | None:
    """Warn of an axis whose motion does not follow from its torque over some seconds."""
    r2 = axis.model.validation.r2_high_passed_rate.get(RATE_SYMBOLS[axis.number], float("nan"))
    if r2 >= _CAUTION_SIMULATED_R2:
        return _own_damping(axis)
    evidence = {
        "simulated_rate_r2": rounded(r2),
        "block_s": HELD_OUT_BLOCK_S,
        "needed_r2": MIN_SIMULATED_R2 if r2 < MIN_SIMULATED_R2 else _CAUTION_SIMULATED_R2,
    }
    enough = r2 >= MIN_SIMULATED_R2 or is_commanded_explained(axis.model, axis.number)
    told = explained_words(r2)
    title = f"Simulated from the torque alone, the model reproduces {told} of the {axis.name} motion"
    return axis.finding("QL511", "warning" if enough else "error", evidence, title)


def _own_damping(axis: _Axis) -> Finding | None:
    """Warn of an axis that speeds itself up: its simulation is fed back from the measured rate."""
    own = axis.model.entries.get((ACCELERATION_SYMBOLS[axis.number], RATE_SYMBOLS[axis.number]))
    if own is None or not own.ci95[0] > 0.0:
        return None
    evidence = {"own_rate_1_s": rounded(own.value), "ci95": [rounded(value) for value in own.ci95]}
    title = f"The {axis.name} model is unstable, so it was checked over {1.0 / own.value:.2g} s only"
    return axis.finding("QL511", "warning", evidence, title)


def _depends_on_the_band(axis: _Axis) -> Finding | None:
    band = axis.model.band_of(axis.number)
    spread = 0.0 if band is None else float(band.spread[axis.number])
    if band is None or spread <= _BAND_WARNING:
        return None
    evidence = {
        "low_hz": [rounded(value) for value in band.low_hz],
        "cutoff_hz": [rounded(value) for value in band.cutoff_hz],
        "gain": [rounded(value) for value in band.on_axis_gain[:, axis.number]],
    }
    return axis.finding("QL503", "error" if spread > _BAND_ERROR else "warning", evidence)


def _changes(change: ChangeCheck, number: int) -> bool:
    """Say whether the effectiveness of an axis changes, beyond chance and by much."""
    return bool(change.seen[number] and change.relative[number] > _CHANGE_WARNING)


def _widens(axis: _Axis, change: ChangeCheck) -> bool:
    """Say whether most of the interval, which covers what was before and after, is a change."""
    low, high = axis.model.entries[ON_AXIS[axis.name]].ci95
    differ = abs(change.after[axis.number] - change.before[axis.number])
    return bool(change.seen[axis.number] and differ > 0.5 * (high - low))


def _others_change(axis: _Axis) -> Finding | None:
    """Warn of an axis that shows no change where both others do: what changes theirs changes its own.

    It may have been commanded at times when the effectiveness was one and the same, and not its mean.
    """
    change = axis.model.change
    others = [number for number in range(len(AXES)) if number != axis.number]
    if change is None or not all(_changes(change, number) for number in others):
        return None
    evidence = {AXES[number]: rounded(float(change.relative[number]), 2) for number in others}
    return axis.finding("QL532", "warning", {"change_of": evidence, **_gain(axis)})


def _changes_in_flight(axis: _Axis) -> Finding | None:
    change = axis.model.change
    if change is None or not _changes(change, axis.number):
        others = _others_change(axis)
        if change is None or others is not None or not _widens(axis, change):
            return others
    relative = float(change.relative[axis.number])
    time_s, before, after = (
        rounded(float(each[axis.number])) for each in (change.time_s, change.before, change.after)
    )
    evidence = {
        "time_s": time_s,
        "gain_before": before,
        "gain_after": after,
        "statistic": rounded(float(change.statistic[axis.number])),
        "needed": CHANGE_SEEN,
    }
    title = (
        f"The {axis.name} effectiveness changes by {100.0 * relative:.0f} % at {time_s:.4g} s into the log"
    )
    level: Level = "info" if relative <= _CHANGE_WARNING else "warning"
    # Of an axis that commands tell, the interval holds both.
    if relative > _CHANGE_ERROR and axis.spectral is None:
        level = "error"
    return axis.finding("QL509", level, evidence, title)


def _inverse_controller(axis: _Axis) -> Finding | None:
    """Refuse a yaw whose torque follows the motion."""
    if axis.number != _YAW or not axis.model.yaw_is_inverse_controller:
        return None
    return axis.finding("QL516", "error", _evidence(axis) | _gain(axis))


def _from_slow_log(axis: _Axis) -> Finding | None:
    """Say on what the effectiveness of yaw in a slow log rests; refuse where it explains nothing at all."""
    band = axis.model.band
    low_hz, cutoff_hz = (math.nan, math.nan) if band is None else (band.low_hz[0], band.cutoff_hz[0])
    evidence = {**_evidence(axis), "low_hz": rounded(float(low_hz)), "cutoff_hz": rounded(float(cutoff_hz))}
    if axis.r2 > 0.0:
        return axis.finding("QL531", "warning", evidence)
    return finding(
        "QL531",
        "error",
        evidence,
        axes=(axis.name,),
        title="Yaw was logged too slowly to confirm its effectiveness",
        advice=axis.logging,
    )


def _told_by_spectra(axis: _Axis) -> Finding | None:
    """Say that an axis was moved by the air as by its commands, and what its effectiveness rests on."""
    fit = axis.spectral
    if fit is None:
        return None
    evidence = {
        **_gain(axis),
        "commanded_r2": rounded(fit.r2_commanded),
        "departure": rounded(fit.departure),
        "torque_commanded": rounded(fit.commanded),
        "segments": fit.n_blocks,
    }
    title = f"The {axis.name} effectiveness comes from the response to commands alone"
    if axis.r2 < _EXPLAINED:
        title = f"Gusts moved {axis.name} too, so its effectiveness comes from the response to commands alone"
    if fit.planned:
        title = (
            f"The {axis.name} effectiveness comes from the planned trajectory alone, because the controller "
            "answers the motion"
        )
    if fit.repeated:
        title = (
            f"The {axis.name} effectiveness comes from what several flights of one trajectory have in common"
        )
    return axis.finding("QL535", "warning" if fit.planned else "info", _evidence(axis) | evidence, title)


def _untold(axis: _Axis) -> Finding | None:
    """Refuse an axis that a fit in time does not explain, and its commands do not tell."""
    fit = axis.asked
    if fit is None:
        return None
    evidence = {
        **_evidence(axis),
        "gain": rounded(fit.gain),
        "ci95": [rounded(fit.gain + sign * fit.half_width) for sign in (-1.0, 1.0)],
        "commanded_r2": rounded(fit.r2_commanded),
        "departure": rounded(fit.departure),
        "segments": fit.n_blocks,
    }
    if fit.follows_commands and fit.is_described:
        percent = 100.0 * fit.half_width / abs(fit.gain)
        title = f"The response to commands gives the {axis.name} effectiveness to ±{percent:.0f} % only"
        return axis.finding("QL505", "error", evidence, title)
    title = f"No single effectiveness, lag and damping describe how {axis.name} responds to its commands"
    return axis.finding("QL504", "error", evidence, title)


_FATAL = (
    _poorly_excited,
    _follows_the_rate,
    _inverse_controller,
    _weakly_commanded,
    _not_explained,
    _wrong_sign,
    _too_wide,
)
_OTHERS = (
    _not_reproduced,
    _depends_on_the_band,
    _changes_in_flight,
    _wide,
    _partly_explained,
)
#: Below 2.5 Hz gusts move a vehicle as its commands do: instruments tell them apart, held-out flight not.
_SLOW_FATAL = (_poorly_excited, _follows_the_rate, _inverse_controller, _wrong_sign, _too_wide)
_SLOW_OTHERS = (_from_slow_log, _depends_on_the_band, _wide)


#: Of an axis that a fit in time does not explain and commands do not tell: why.
_UNTOLD = (_poorly_excited, _follows_the_rate, _inverse_controller, _weakly_commanded, _untold)
#: Rough air hides how well an axis follows its torque, and does not touch how it answers its commands.
_SPECTRAL_FATAL = (_poorly_excited, _wrong_sign, _too_wide)
_SPECTRAL_OTHERS = (_told_by_spectra, _changes_in_flight, _wide)


def _windows(identification: Identification) -> Iterator[Finding]:
    """Say how many of the published windows rise above the noise, once for all structures that have them."""
    weak = {}
    for model in identification.models:
        windows = model.windows
        if windows is None or model.actuator is not None:
            continue
        fraction = float(np.mean(windows.used)) if windows.used.size else 0.0
        if fraction < _FEW_WINDOWS:
            weak[model.structure] = {
                "windows": int(windows.used.size),
                "above_noise": int(np.count_nonzero(windows.used)),
                "median_condition_number": rounded(float(np.median(windows.condition_number))),
                "rank_deficient": int(np.count_nonzero(windows.rank < windows.singular_values.shape[1])),
            }
    if weak:
        yield finding("QL501", "info", weak)
